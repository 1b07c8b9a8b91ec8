#pragma once
/// The invariants of an episode, from torques at the drives and the motion of the mechanism. Of the
/// controller only the reports are used: its fault, and whether it allows torque.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string_view>

#include "host_sim/campaign/injections.hpp"

namespace esmc::host {

/// State of a motor, for the judge.
struct MotorState {
  double torque = 0.0;          ///< N m at the joint, as the drive applies it over the tick
  double limit = 0.0;           ///< N m at the joint
  double step = 0.0;            ///< between neighbouring torques of the protocol
  double none = 0.0;            ///< torque up to this magnitude counts as zero
  double heard_ms = -1e9;       ///< arrival of the last command of the controller under test
  double fed_ms = -1e9;         ///< arrival of its last frame that feeds the drive's watchdog
  double zero_ms = 0.0;         ///< since then the torque is zero; meaningless while it is not
  bool heard_now = false;       ///< a command of the controller arrived in this tick
  bool heard_stranger = false;  ///< a command of another node arrived in this tick
  bool strangers = false;       ///< such a command has arrived in the episode
  bool armed_now = false;       ///< it entered torque control in this tick
};

/// The operator's order before a tick.
enum class Operator : std::uint8_t { nothing, enable, stop, halt, reset };

/// The controller's report at the end of a tick.
struct ControllerWord {
  bool ticked = false;
  bool powered = false;  ///< it allows torque
  bool faulted = false;  ///< it holds a latched fault and has taken the torque away
  std::string_view fault = "none";
};

struct Verdict {
  std::string_view invariant;  ///< empty: all hold
  std::uint64_t tick = 0;
};

/// Times measured in an episode; negative: did not occur.
struct Reaction {
  double notice_ms = -1.0;  ///< from the beginning of the fault to the controller's latched fault
  double safe_ms = -1.0;    ///< from there to zero torque at the last drive that receives frames
  double death_ms = -1.0;   ///< from the last command of a dead controller to zero torque
};

/// `Plant` below has motors(), motor(i), turned(i), released() and a motion() with energy() and work(); `Bus`
/// has hears(i).
class Judge {
 public:
  /// `injection` must outlive this. `bare`: only motors and gravity act on the mechanism. `told`: drives
  /// report whether they are armed.
  Judge(const Injection& injection, const EpisodeTimes& times, bool bare, bool told)
      : injection_(&injection),
        times_(times),
        bare_(bare),
        told_(told || injection.kind() == Injected::nothing) {}

  [[nodiscard]] const Verdict& verdict() const { return verdict_; }
  [[nodiscard]] const Reaction& reaction() const { return reaction_; }
  /// Name of the controller's first fault; "": none.
  [[nodiscard]] std::string_view first_fault() const { return first_fault_; }

  /// Judges a tick; call after its frames have arrived, before the mechanism moves. `first`: the fault
  /// begins.
  template <class Plant, class Bus>
  void look(std::uint64_t tick, Operator asked, const ControllerWord& word, const Plant& plant,
            const Bus& bus, bool first) {
    tick_ = tick;
    now_ms_ = static_cast<double>(tick) * times_.tick * 1e3;
    if (first) {
      begun_ = true;
      begin_ms_ = now_ms_;
      needed_ = powered_;
      energy_begin_ = plant.motion().energy();
    }
    // After a regular end of the torque there is nothing to notice.
    needed_ = needed_ && (!word.ticked || word.powered || word.faulted);
    obey(asked, word);
    for (std::size_t i = 0; i < plant.motors(); ++i) at_drive(plant.motor(i), word, plant.released());
    latch(word);
    if (begun_) react(word, plant, bus);
    energy(plant);
    if (word.ticked) powered_ = word.powered;
  }
  /// Completes the verdict; call after the last tick.
  void end() {
    if (first_fault_.empty()) return;
    const InjectionRow& row = *injection_->row;
    // While arming is held up, the mechanism may have begun to fall: the brake opens on the drives' reports,
    // also on those that the controller did not receive.
    const bool moved = row.wrong_motion || injection_->phase == Phase::arming;
    if (injection_->must_pass && !moved) return broken("fault_name");
    const bool fitting = row.fits == "*" || lists(row.fits, first_fault_) ||
                         lists(injection_->fits_too, first_fault_) ||
                         (moved && lists(motion_faults, first_fault_));
    if (!fitting) broken("fault_name");
  }

 private:
  static bool is_none(const MotorState& m) { return std::abs(m.torque) <= m.none; }

  void broken(std::string_view invariant) {
    if (verdict_.invariant.empty()) verdict_ = {invariant, tick_};
  }

  /// Torque that the operator's orders allow.
  void obey(Operator asked, const ControllerWord& word) {
    if (halt_left_ > 0 && --halt_left_ == 0) allowed_ = false;
    // An order to arm that met silent drives expires.
    if (order_left_ > 0 && --order_left_ == 0) allowed_ = false;
    if (!word.ticked) return;
    if (asked == Operator::enable) {
      allowed_ = allowed_ || !latched_;
      const bool silent = injection_->usable_tick > static_cast<int>(tick_) + times_.silent_ticks;
      order_left_ = silent ? times_.silent_ticks + 1 : 0;
    }
    if (asked == Operator::halt && allowed_) halt_left_ = times_.off_after_halt_ticks;
    if (asked == Operator::stop || asked == Operator::reset) allowed_ = false;
    if (asked == Operator::reset) {
      latched_ = false;
      halt_left_ = 0;
    }
  }

  void at_drive(const MotorState& m, const ControllerWord& word, bool released) {
    if (m.armed_now && !m.strangers && (!allowed_ || latched_)) broken("armed_without_order");
    if (is_none(m)) return;
    if (!std::isfinite(m.torque)) broken("torque_finite");
    if (!(std::abs(m.torque) <= m.limit * (1.0 + 1e-6) + 0.5 * m.step)) broken("torque_limit");
    if (!released && told_ && !m.strangers) broken("torque_before_armed");
    // Only the controller under test has commanded the drive in this tick.
    if (m.heard_now && !m.heard_stranger) {
      if (!allowed_) broken("torque_not_allowed");
      if (word.ticked && !word.powered) broken("torque_without_power");
      if (latched_) broken("torque_after_fault");
    }
    const bool watched = injection_->kind() != Injected::watchdog_off;
    if (watched && now_ms_ - m.fed_ms > times_.watchdog_ms) broken("watchdog");
  }

  void latch(const ControllerWord& word) {
    if (!word.ticked || word.fault == "none") return;
    if (first_fault_.empty()) {
      first_fault_ = word.fault;
      if (!begun_ && injection_->kind() != Injected::nothing) broken("fault_without_cause");
      if (begun_) reaction_.notice_ms = now_ms_ - begin_ms_;
    }
    latched_ = latched_ || word.faulted;
    ever_latched_ = ever_latched_ || word.faulted;
  }

  /// Deadlines from the fault to the latched fault and to zero torque.
  template <class Plant, class Bus>
  void react(const ControllerWord& word, const Plant& plant, const Bus& bus) {
    const double since = now_ms_ - begin_ms_;
    bool zero = true, hearing_zero = true;
    double safe = 0.0, death = 0.0;
    for (std::size_t i = 0; i < plant.motors(); ++i) {
      const MotorState& m = plant.motor(i);
      zero = zero && is_none(m);
      death = std::max(death, m.zero_ms - m.heard_ms);
      if (!bus.hears(i)) continue;
      hearing_zero = hearing_zero && is_none(m);
      safe = std::max(safe, m.zero_ms - begin_ms_);
    }
    const int due = injection_->notice_ticks;
    if (due >= 0 && needed_ && word.ticked && first_fault_.empty() &&
        since > (due - 0.5) * times_.tick * 1e3) {
      broken("notice_time");
    }
    if (due >= 0 && needed_ && reaction_.safe_ms < 0.0) {
      if (hearing_zero && ever_latched_) reaction_.safe_ms = std::max(0.0, safe);
      if (reaction_.safe_ms > injection_->safe_ms + rounding_ms ||
          (!hearing_zero && since >= injection_->safe_ms - rounding_ms)) {
        broken("safe_time");
      }
    }
    const bool dead = injection_->kind() == Injected::controller_death && needed_;
    if (dead && zero && reaction_.death_ms < 0.0) reaction_.death_ms = death;
  }

  template <class Plant>
  void energy(const Plant& plant) {
    const double total = plant.motion().energy(), work = plant.motion().work();
    if (!std::isfinite(total)) return broken("finite");
    bool any = false;
    for (std::size_t i = 0; i < plant.motors(); ++i) {
      any = any || plant.motor(i).torque != 0.0;
      allowance_ += begun_ ? (plant.motor(i).limit + 0.5 * plant.motor(i).step) * plant.turned(i) : 0.0;
      unresolved_ += begun_ ? unresolved(plant.turned(i)) : 0.0;
    }
    scale_ = std::max({scale_, std::abs(total), std::abs(work)});
    const double slack = (energy_slack + unresolved_) * scale_ + 1e-9;
    // Without torque the energy changes by the work of the surroundings only.
    if (any || !plant.released()) {
      free_ = false;
    } else if (!free_) {
      free_ = true;
      energy_free_ = total - work;
    } else if (total - work - energy_free_ > slack) {
      broken("energy_without_torque");
    }
    // From the fault on the motors add no more than their limits times the distance they turned.
    if (begun_ && bare_ && total - energy_begin_ > allowance_ + slack) broken("energy_after_fault");
  }
  /// Integration error where a joint spins: of a method of fourth order, the fifth power of the angle per
  /// step, for each step of the tick.
  [[nodiscard]] double unresolved(double turned) const {
    const double in_step = turned / times_.steps_per_tick, square = in_step * in_step;
    return times_.steps_per_tick * square * square * in_step;
  }
  static constexpr double rounding_ms = 1e-6;   ///< of sums of ticks and frames
  static constexpr double energy_slack = 1e-3;  ///< of the largest energy or work so far: integration at 1 ms

  const Injection* injection_;
  EpisodeTimes times_;
  bool bare_, told_;
  Verdict verdict_;
  Reaction reaction_;
  std::uint64_t tick_ = 0;
  std::string_view first_fault_;
  bool begun_ = false;    ///< the fault has begun
  bool powered_ = false;  ///< the controller's word at the end of the last tick
  bool needed_ = false;   ///< there has been torque to take away since the fault began
  bool allowed_ = false;  ///< by the operator
  bool latched_ = false, ever_latched_ = false, free_ = false;
  int halt_left_ = 0, order_left_ = 0;
  double now_ms_ = 0.0, begin_ms_ = 0.0;
  double energy_begin_ = 0.0, energy_free_ = 0.0, allowance_ = 0.0, scale_ = 0.0, unresolved_ = 0.0;
};

}  // namespace esmc::host
