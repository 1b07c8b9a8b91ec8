#pragma once
/// A NUCLEO board; "chip.hpp" is in the folder of the board.

#include "boards/cortex_m/memory.hpp"
#include "boards/node.hpp"
#include "chip.hpp"

namespace esmc::stm32 {

/// The CAN controller whose interrupt is enabled; null before.
inline Chip::Can* interrupting_can = nullptr;

/// Bus, watchdog, pins, clock, console and slots of a NUCLEO board for the loops of node.hpp.
class NucleoBoard {
 public:
  /// Sets up the pins first, so that outputs are low; then the console, on the internal oscillator.
  NucleoBoard() {
    Chip::start_ports();
    for (const Pin& output : {Chip::drive_enable, Chip::brake, Chip::light}) output.output_low();
    Chip::enable.input_pulled_down();
    for (const Function& f : Chip::functions) f.pin.alternate(f.number, f.pull_up);
    cause_ = Chip::reset_cause();
    console_.start(Chip::reset_clock_hz);
  }
  /// Starts the clocks. Returns `none`, or the step that failed, at which it stopped.
  [[nodiscard]] StartFault start() {
    if (const StartFault fault = Chip::start_clocks(); fault != StartFault::none) return fault;
    console_.start(Chip::console_clock_hz);
    start_microseconds(Chip::timer_clock_hz);
    return StartFault::none;
  }
  /// Joins the bus (bit/s; data_rate 0: classic), after start(), and enables its interrupt, the only one.
  /// Frames wait for age_max_us at most. False: not possible.
  [[nodiscard]] bool join(Word bit_rate, Word data_rate, const hal::IdFilters& filters, Word age_max_us) {
    if (!open(bit_rate, data_rate, filters, false, age_max_us)) return false;
    interrupting_can = &bus_;
    enable_interrupt(ESMC_CAN_INTERRUPT);
    return true;
  }
  /// The bus without its interrupt: see Fdcan::open.
  [[nodiscard]] bool open(Word bit_rate, Word data_rate, const hal::IdFilters& filters, bool loop_back,
                          Word age_max_us) {
    const bool fd = data_rate != 0;
    Chip::prepare_can(fd);
    return bus_.open(Chip::can_clock_hz(fd), bit_rate, data_rate, filters, loop_back, age_max_us);
  }

  [[nodiscard]] Chip::Can& bus() { return bus_; }
  [[nodiscard]] static const IndependentWatchdog& watchdog() { return Chip::watchdog; }
  [[nodiscard]] static const Pin& enable() { return Chip::enable; }
  [[nodiscard]] static const Pin& drive_enable() { return Chip::drive_enable; }
  [[nodiscard]] static const Pin& brake() { return Chip::brake; }
  /// Slots of parameters, in bank 2 of the flash; the code lies in bank 1 (memory.ld), which stays readable
  /// while bank 2 is erased (25 ms on a G4, up to four seconds on an H7). So ticks and the refresh of the
  /// watchdog go on; only a read of bank 2 would wait, and the driver does not read it then.
  [[nodiscard]] Chip::Slots& slots() { return slots_; }
  [[nodiscard]] Word now_us() const { return microseconds(); }  ///< since start(), wraps after 71 minutes
  [[nodiscard]] Console& console() { return console_; }
  /// Flags of the last reset: see Chip::reset_cause().
  [[nodiscard]] Word reset_cause() const { return cause_; }

 private:
  Chip::Can bus_{Chip::CanMemory{}};
  Chip::Slots slots_{{}};
  Console console_{Chip::console};
  Word cause_ = 0;
};
static_assert(Board<NucleoBoard>);

}  // namespace esmc::stm32

extern "C" [[gnu::used]] inline void esmc_can_interrupt() { esmc::stm32::interrupting_can->interrupt(); }
