#pragma once
/// The controller's end of the command interface: what a supervisor computer asks for, checked, and what it
/// is told. docs/command-interface.md is the contract.
///
/// A tick:  begin_tick  ->  receive for every frame  ->  take, the wishes of the tick  ->  transmit.
/// Nothing that fails a check has an effect, and every failure is counted.

#include <array>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "firmware/link/codec.hpp"
#include "firmware/link/fault_memory.hpp"
#include "firmware/link/link_types.hpp"
#include "firmware/link/parameters.hpp"

namespace esmc::link {

/// The controller's end of the interface to a supervisor computer.
class CommandLink {
 public:
  CommandLink() = default;
  explicit CommandLink(const LinkConfig& c)
      : config_(c), parameters_(c.parameters), session_(c.session), source_(c.source) {}

  [[nodiscard]] bool active() const { return config_.base_id != 0; }
  [[nodiscard]] const Parameters& parameters() const { return parameters_; }
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] std::uint8_t session() const { return session_; }
  [[nodiscard]] Source source() const { return source_; }
  [[nodiscard]] std::uint32_t scene() const { return config_.scene; }

  /// Once per tick, before its frames.
  void begin_tick() { ++tick_; }

  /// `waited`: ticks that the frame has waited to be received, below 2^31.
  Outcome receive(const hal::CanFrame& f, std::uint32_t waited = 0) {
    waited_ticks_ = waited;
    if (!active() || f.extended || f.id - config_.base_id >= block_size) return Outcome::not_mine;
    const auto m = static_cast<std::uint8_t>(f.id - config_.base_id);
    if (m >= outgoing_first) return f.remote ? Outcome::not_mine : Outcome::foreign_command;
    const Outcome o = m < incoming_count ? judge(f, m) : Outcome::malformed;
    count(o);
    return o;
  }

  /// The wishes since the last call.
  [[nodiscard]] Request take() {
    Request r = request_;
    request_ = {};
    r.source = source_;
    return r;
  }
  /// At power-up, before the first tick: gains of an earlier one. The next take() has them. False: not
  /// acceptable, none is taken.
  bool restore(const Gains& g) {
    const bool good = parameters_.restore(g);
    request_.has_gains = request_.has_gains || good;
    return good;
  }
  /// What is wanted of the store since the last call, and what has become of it: told as soon as it changes.
  /// Without a word of a store there is none.
  [[nodiscard]] StoreWish take_store_wish() { return std::exchange(store_wish_, StoreWish::none); }
  void store_status(const StoreStatus& s) {
    asked_slots_ = asked_slots_ || s != store_;
    store_ = s;
  }
  /// A set point that take() gave could not be followed.
  void refuse() { count(Outcome::refused); }

  /// Whether the supervisor computer is missed: no frame at all for more than `silence` ticks in any state
  /// that it has armed, or while running no sample of a stream that has begun for more than stream_age.
  [[nodiscard]] bool lost() const {
    const auto silence = static_cast<std::uint32_t>(parameters_[Index::silence]);
    const bool armed = state_ != State::disabled && state_ != State::stopping && state_ != State::fault;
    return (armed && silence > 0 && tick_ - heard_tick_ > silence) ||
           (streaming_ && tick_ - sample_tick_ > static_cast<std::uint32_t>(parameters_[Index::stream_age]));
  }

  /// At the end of a tick. `send` says whether the bus took the frame.
  template <class Send>
  void transmit(const Supervisor& s, const Report& r, Send&& send) {
    follow(s.state());
    faults_.look(s, static_cast<std::uint32_t>(tick_ * config_.period_ns / 1000U), r.axis, r.drive_error);
    const bool news = s.state() != told_state_ || s.fault() != told_fault_;
    const bool status_due = status_.due(config_.status_ticks),
               telemetry_due = telemetry_.due(config_.telemetry_ticks);
    if (news || status_due) {
      if (send(encode_status(config_.base_id, status(s), ++counter_))) {
        told_state_ = s.state();
        told_fault_ = s.fault();
      }
      faults_.transmit(config_.base_id, s.fault(), send);
    }
    if (telemetry_due && untold_ == 0) {
      kept_ = r;
      untold_ = telemetry_first + r.joints;
    }
    if (untold_ > 0) telemetry(send);
    if (table_.due(config_.table_ticks)) {
      asked_table_ = asked_identity_ = true;
      asked_slots_ = asked_slots_ || store_.state != StoreState::none;
    }
    answer(send);
  }

 private:
  static constexpr std::uint8_t counter_never = 0xFF;
  static constexpr unsigned telemetry_first = 2;  // effector and tracking error, then the joints

  // ---- to the controller
  // --------------------------------------------------------------------------------------

  Outcome judge(const hal::CanFrame& f, std::uint8_t m) {
    if (f.size != 8 || f.remote || f.fd) return Outcome::malformed;
    const auto message = static_cast<Message>(m);
    if (!intact(f, session_)) {
      return message == Message::command && intact(f, any_session) ? without_session(f) : Outcome::bad_crc;
    }
    const bool in_order = ahead(m, counter_of(f));
    if (in_order) {  // whatever becomes of it, it has been heard
      last_[m] = counter_of(f);
      heard_tick_ = tick_;
    }
    if (message == Message::command) {
      const auto c = decode_command(f);
      if (!c) return Outcome::malformed;
      // What takes torque away is not held up by a counter.
      return in_order || takes_away(c->order) ? order(*c) : Outcome::bad_counter;
    }
    if (!in_order) return Outcome::bad_counter;
    switch (message) {
      case Message::set_point:
        return set_point(decode_pair(f, position_unit));
      case Message::stream_position:
        return position(f);
      case Message::stream_velocity:
        return velocity(f);
      case Message::parameter_write:
        return write(decode_parameter_write(f));
      default:
        return answer_to(decode_request(f));
    }
  }
  /// The next frame of this identifier, or not more than the configured number of frames later.
  [[nodiscard]] bool ahead(std::uint8_t m, std::uint8_t counter) const {
    const unsigned step = (counter - last_[m]) & 0x0FU;
    return last_[m] == counter_never || (step >= 1 && step <= config_.counter_jump_max);
  }
  static bool takes_away(Order o) { return o == Order::disarm || o == Order::off; }

  /// From whoever has not heard which session this is: only what takes torque away.
  Outcome without_session(const hal::CanFrame& f) {
    const auto c = decode_command(f);
    if (!c || !takes_away(c->order)) return Outcome::refused;
    return order(*c);
  }

  Outcome order(const CommandFrame& c) {
    if (c.order == Order::none) return Outcome::obeyed;
    if (takes_away(c.order)) {
      // An off of the same tick is not softened by a disarm.
      if (request_.command != Command::stop) {
        request_.command = c.order == Order::off ? Command::stop : Command::halt;
      }
      return Outcome::obeyed;
    }
    const auto age = static_cast<std::uint16_t>(tick_ - c.tick);
    if (age + waited_ticks_ > config_.command_age_ticks_max) return Outcome::refused;
    if (request_.command != Command::none) return Outcome::refused;
    const bool disabled = state_ == State::disabled;
    switch (c.order) {
      case Order::arm:
        if (!disabled || storing() || !known_table(c)) return Outcome::refused;
        request_.command = Command::enable;
        return Outcome::obeyed;
      case Order::store:
        return known_table(c) ? keep(StoreWish::store) : Outcome::refused;
      case Order::forget:
        return keep(StoreWish::forget);
      case Order::reset:
        request_.command = Command::reset;
        return Outcome::obeyed;
      case Order::confirm_zero:
        if (!disabled) return Outcome::refused;
        request_.command = Command::confirm_zero;
        return Outcome::obeyed;
      case Order::hold:
        return hold();
      default:
        if (!disabled) return Outcome::refused;
        source_ = c.order == Order::stream ? Source::stream : Source::reference;
        return Outcome::obeyed;
    }
  }
  /// What is armed or stored is what the operator's program has seen.
  [[nodiscard]] bool known_table(const CommandFrame& c) const {
    return c.parameters == static_cast<std::uint16_t>(parameters_.crc());
  }
  /// Until it is done neither arming nor another value: what is stored is one table and not two, and no tick
  /// with torque has a flash memory at work beside it (on an STM32G4 the data cache is off meanwhile, which
  /// makes ticks longer).
  [[nodiscard]] bool storing() const {
    return store_.state == StoreState::storing || store_.state == StoreState::forgetting;
  }
  Outcome keep(StoreWish wish) {
    if (state_ != State::disabled || storing() || store_.state == StoreState::none) return Outcome::refused;
    store_wish_ = wish;
    StoreStatus s = store_;
    s.state = wish == StoreWish::store ? StoreState::storing : StoreState::forgetting;
    store_status(s);
    if (wish == StoreWish::forget) {
      parameters_ = config_.parameters;
      request_.has_gains = asked_table_ = true;
    }
    return Outcome::obeyed;
  }
  Outcome hold() {
    if (state_ == State::disabled) {
      source_ = Source::hold;
      return Outcome::obeyed;
    }
    if (!guided()) return Outcome::refused;
    streaming_ = half_ = false;
    request_.has_point = request_.has_sample = false;
    request_.hold = true;
    return Outcome::obeyed;
  }
  /// Set points and samples count.
  [[nodiscard]] bool guided() const { return state_ == State::running && source_ == Source::stream; }

  [[nodiscard]] bool within(const std::array<float, 2>& p) const {
    bool in = true;
    for (unsigned i = 0; i < 2; ++i)
      in = in && p[i] >= config_.position[i].lower && p[i] <= config_.position[i].upper;
    return in;
  }
  /// No coordinate above `most`.
  static bool below(const std::array<float, 2>& v, float most) {
    return v[0] <= most && -v[0] <= most && v[1] <= most && -v[1] <= most;
  }
  static std::array<float, 2> difference(const std::array<float, 2>& a, const std::array<float, 2>& b) {
    return {a[0] - b[0], a[1] - b[1]};
  }

  Outcome set_point(const std::optional<Pair>& p) {
    if (!p) return Outcome::malformed;
    if (!guided() || p->space != config_.space || !within(p->value)) return Outcome::refused;
    streaming_ = half_ = false;
    request_.hold = request_.has_sample = false;
    request_.has_point = true;
    request_.position = p->value;
    return Outcome::obeyed;
  }

  /// Half a sample; its velocity follows with the same counter.
  Outcome position(const hal::CanFrame& f) {
    const auto p = decode_pair(f, position_unit);
    half_ = false;
    if (!p) return Outcome::malformed;
    if (!guided() || p->space != config_.space || !within(p->value)) return Outcome::refused;
    half_ = true;
    half_counter_ = counter_of(f);
    half_position_ = p->value;
    return Outcome::obeyed;
  }
  Outcome velocity(const hal::CanFrame& f) {
    const auto v = decode_pair(f, velocity_unit);
    if (!v) return Outcome::malformed;
    const bool whole = half_ && half_counter_ == counter_of(f) && v->space == config_.space;
    half_ = false;
    if (!guided() || !whole || !below(v->value, parameters_[Index::speed]) || !continuous(v->value)) {
      return Outcome::refused;
    }
    streaming_ = true;
    sample_tick_ = tick_;
    request_.hold = request_.has_point = false;
    request_.has_sample = true;
    request_.position = last_position_ = half_position_;
    request_.velocity = last_velocity_ = v->value;
    return Outcome::obeyed;
  }
  /// No further from the sample before than speed and acceleration allow, with one tick for the time on the
  /// way.
  [[nodiscard]] bool continuous(const std::array<float, 2>& v) const {
    if (!streaming_) return true;  // the first one is joined by a quintic
    const float time = static_cast<float>(tick_ - sample_tick_ + 1) * parameters_[Index::sample_time];
    return below(difference(half_position_, last_position_),
                 parameters_[Index::speed] * time + position_unit) &&
           below(difference(v, last_velocity_), parameters_[Index::acceleration] * time + velocity_unit);
  }

  Outcome write(const std::optional<ParameterWrite>& w) {
    if (!w) return Outcome::malformed;
    answer_ = parameters_.write(w->index, w->value, state_ == State::disabled && !storing());
    asked_parameter_ = true;
    asked_index_ = w->index;
    if (answer_ != Answer::ok) return Outcome::refused;
    request_.has_gains = true;
    asked_table_ = true;
    return Outcome::obeyed;
  }
  Outcome answer_to(const std::optional<RequestFrame>& q) {
    if (!q) return Outcome::malformed;
    switch (q->subject) {
      case Subject::faults:
        faults_.read_out();
        break;
      case Subject::table:
        asked_table_ = asked_identity_ = asked_slots_ = true;
        break;
      default:
        asked_parameter_ = true;
        asked_index_ = q->index;
        answer_ = q->index < parameter_count ? Answer::ok : Answer::unknown_index;
        break;
    }
    return Outcome::obeyed;
  }

  void count(Outcome o) {
    std::uint16_t& n = o == Outcome::obeyed        ? counters_.obeyed
                       : o == Outcome::bad_crc     ? counters_.bad_crc
                       : o == Outcome::bad_counter ? counters_.bad_counter
                                                   : counters_.refused;
    if (n < 0xFFFF) ++n;
  }

  // ---- from the controller
  // ------------------------------------------------------------------------------------

  /// Once in so many ticks, the first time after so many. A remainder of the tick's number would cost a
  /// division of 64 bits.
  class Every {
   public:
    [[nodiscard]] bool due(std::uint32_t ticks) {
      if (++passed_ < ticks || ticks == 0) return false;
      passed_ = 0;
      return true;
    }

   private:
    std::uint32_t passed_ = 0;
  };

  /// What a change of state does to the link: a recording of this episode is worth nothing in the next one.
  void follow(State now) {
    if (now == State::disabled && state_ != State::disabled) session_ = session_ == 0xFF ? 1 : session_ + 1;
    if (now != State::running) streaming_ = half_ = false;
    if (state_ == State::disabled) heard_tick_ = tick_;
    state_ = now;
  }
  [[nodiscard]] Status status(const Supervisor& s) const {
    const Reacted reacted = s.fault() == Fault::none    ? Reacted::none
                            : s.state() == State::fault ? Reacted::zero_torque
                                                        : Reacted::halt;
    return {s.state(), s.fault(), reacted, source_, streaming_, static_cast<std::uint32_t>(tick_), session_};
  }
  /// One frame of what one tick was like: a set in a single tick would hold up everything else on the bus.
  template <class Send>
  void telemetry(Send&& send) {
    const unsigned done = telemetry_first + kept_.joints - untold_;
    const auto m = static_cast<std::uint8_t>(static_cast<unsigned>(Message::effector) + done);
    const auto& pair = done == 0 ? kept_.effector : kept_.error;
    const bool sent = done < telemetry_first
                          ? send(encode_floats(config_.base_id, m, pair[0], pair[1]))
                          : send(encode_floats(config_.base_id, m, kept_.angle[done - telemetry_first],
                                               kept_.torque[done - telemetry_first]));
    if (sent) --untold_;
  }
  template <class Send>
  void answer(Send&& send) {
    if (asked_parameter_) {
      const bool known = asked_index_ < parameter_count;
      asked_parameter_ = !send(encode_parameter_value(config_.base_id, asked_index_, answer_,
                                                      parameters_.writable(asked_index_),
                                                      known ? parameters_.at(asked_index_) : 0.0F));
    }
    if (asked_table_) {
      asked_table_ = !send(encode_parameter_table(config_.base_id, parameters_.crc(), parameter_count));
      (void)send(encode_counters(config_.base_id, counters_));
    }
    if (asked_identity_) asked_identity_ = !send(encode_identity(config_.base_id, config_.scene));
    if (asked_slots_) asked_slots_ = !send(encode_parameter_slots(config_.base_id, store_));
  }

  LinkConfig config_{};
  Parameters parameters_{};
  FaultMemory faults_{};
  Counters counters_{};
  Request request_{};
  std::array<std::uint8_t, incoming_count> last_ = {counter_never, counter_never, counter_never,
                                                    counter_never, counter_never, counter_never};
  std::uint64_t tick_ = 0;
  std::uint64_t sample_tick_ = 0, heard_tick_ = 0;
  std::uint32_t waited_ticks_ = 0;  ///< of the frame at hand
  std::uint8_t session_ = 1;
  std::uint8_t counter_ = 0;  // of Status
  Source source_ = Source::reference;
  State state_ = State::disabled, told_state_ = State::disabled;
  Fault told_fault_ = Fault::none;
  bool streaming_ = false;  // samples came since the start, and neither a set point nor hold after them
  bool half_ = false;       // a position that waits for its velocity
  std::uint8_t half_counter_ = 0;
  std::array<float, 2> half_position_{}, last_position_{}, last_velocity_{};
  bool asked_parameter_ = false, asked_table_ = false, asked_slots_ = false;
  bool asked_identity_ = true;  // by nobody, at power-up
  Every status_, telemetry_, table_;
  std::uint8_t asked_index_ = 0;
  Answer answer_ = Answer::ok;
  StoreStatus store_{};
  StoreWish store_wish_ = StoreWish::none;
  Report kept_{};        // of the tick that is being told
  unsigned untold_ = 0;  // frames of it
};

static_assert(std::is_trivially_copyable_v<CommandLink>);
static_assert(state_count <= 16 && fault_count <= 255, "fields of Status");

}  // namespace esmc::link
