#pragma once
/// An emulated CiA 402 drive on CANopen: object dictionary behind an SDO server, PDOs as they are mapped,
/// network management, heartbeats both ways, emergency messages, and the power state machine.

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "host_sim/drives/emulated_axis.hpp"
#include "host_sim/scene/drive_defects.hpp"

namespace esmc::host {

class Cia402Axis final : public EmulatedAxis {
 public:
  /// An object as a vendor's list (EDS, DCF) has it.
  struct ListedObject {
    std::uint16_t index = 0;
    std::uint8_t sub = 0, bytes = 4;
    bool writable = false;
    std::optional<std::uint32_t> value{};  ///< at the start; empty: that of an emulated drive
  };
  struct Settings {
    /// In lockstep publish() begins a tick: it reports that the drive is not operational, or sends the PDOs,
    /// with the present reading, for the SYNC that ended the last tick. Otherwise the drive answers SYNC at
    /// once with its last reading, and sends heartbeats by object 1017 only.
    bool lockstep = true;
    double period = 1e-3;             ///< s of virtual time between calls of publish()
    double rated_torque = 1.0;        ///< N m at the shaft
    double rated_torque_unit = 1e-3;  ///< N m per LSB of object 6076
    double max_torque = 3.0;          ///< in rated torques, object 6072 where there is one
    double counts_per_turn = 1048576.0;
    double velocity_unit = 1.0471976e-4;  ///< rad/s per LSB of object 606C
    Defects defects{};
    std::vector<ListedObject> objects{};  ///< the only ones it has; empty: all
  };

  Cia402Axis(const AxisMount& mount, const Settings& settings, const SensorEffects& sensor, int joint,
             std::uint64_t seed);

  void publish(double joint_angle, double joint_rate, const Send& send) override;
  /// Takes a frame. True, in lockstep: the controller's tick is over, with its torque frame (RPDO1) while not
  /// operational and with the SYNC after it when operational.
  bool receive(const hal::CanFrame& f, const Send& send) override;
  [[nodiscard]] bool commanded_by(const hal::CanFrame& f) const override;
  [[nodiscard]] bool closed_loop() const override;
  /// Error code, object 603F; 0: none.
  [[nodiscard]] std::uint32_t error() const override { return value(0x603F, 0); }

  /// Value of an object of the dictionary; 0 also where there is no such object.
  [[nodiscard]] std::uint32_t value(std::uint16_t index, std::uint8_t sub) const;

 private:
  enum class Power { not_ready, disabled, ready, on, enabled, quick_stop, fault_reaction, fault };
  struct Entry {
    std::uint32_t value = 0;
    std::uint8_t bytes = 4;
    bool writable = false;
  };
  static constexpr std::uint32_t key(std::uint16_t index, std::uint8_t sub) {
    return (std::uint32_t{index} << 8U) | sub;
  }

  void define_communication();
  void define_drive();
  void restrict_dictionary();
  void define(std::uint16_t index, std::uint8_t sub, std::uint8_t bytes, std::uint32_t value, bool writable);
  void set(std::uint16_t index, std::uint8_t sub, std::uint32_t value);

  void serve(const hal::CanFrame& request, const Send& send);
  /// SDO abort code for writing this value; 0: allowed.
  [[nodiscard]] std::uint32_t objection(std::uint16_t index, std::uint8_t sub, std::uint32_t value) const;
  [[nodiscard]] std::uint32_t objection_to_pdo(std::uint16_t index, std::uint8_t sub,
                                               std::uint32_t value) const;
  void write(std::uint16_t index, std::uint8_t sub, std::uint32_t value, const Send& send);

  void manage(const hal::CanFrame& f, const Send& send);
  void leave_operational(std::uint8_t to, const Send& send);
  void report_state(const Send& send);
  void watch_master(const Send& send);
  void watch_commands(const Send& send);
  void connection_lost(std::uint16_t code, const Send& send);
  void synchronise(const Send& send);
  void send_pdo(unsigned number, const Send& send);
  void receive_pdo(unsigned number, const hal::CanFrame& f, const Send& send);
  void emergency(std::uint16_t code, const Send& send);

  void control(std::uint16_t word, const Send& send);
  void go(Power to);
  void quick_stop();
  void fail(std::uint16_t code, const Send& send);
  [[nodiscard]] std::uint16_t statusword() const;
  [[nodiscard]] bool faulty() const { return power_ == Power::fault || power_ == Power::fault_reaction; }
  void refresh();
  [[nodiscard]] double shaft_torque() const override;
  /// Target torque after the drive's limit, thousandths of the rated torque; 0 unless it acts.
  [[nodiscard]] double acting_torque() const;

  static constexpr unsigned pdos = 4;

  Settings settings_;
  std::map<std::uint32_t, Entry> objects_;
  Power power_ = Power::disabled;
  std::uint8_t nmt_ = 0x7F;  // as in its heartbeat
  bool booted_ = false;      // the boot-up message has been sent
  std::uint16_t last_control_ = 0;
  std::array<StaleBytes, pdos> stale_{};
  std::array<unsigned, pdos> syncs_{};     // since a TPDO was sent
  std::array<bool, pdos> due_{};           // lockstep: a SYNC has asked for it
  std::array<bool, pdos> expected_{};      // RPDOs that have come since NMT start, whose deadlines run
  std::array<double, pdos> since_rpdo_{};  // s
  double since_heartbeat_ = 0.0;
  double since_master_ = 0.0;
  bool watching_ = false;  // a heartbeat of the master has been heard
  bool lost_ = false;      // and then none for too long
  bool told_ = false;      // lockstep: the torque frame of the tick has come
};

}  // namespace esmc::host
