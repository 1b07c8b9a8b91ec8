#pragma once
/// The controller's end of the command interface: checks the frames of a supervisor computer and answers
/// them. docs/command-interface.md is the contract.
///
/// A tick:  begin_tick  ->  receive for every frame  ->  take, the requests of the tick  ->  transmit.
/// A frame that fails a check has no effect and is counted.

#include <array>
#include <bit>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "firmware/link/capture.hpp"
#include "firmware/link/codec.hpp"
#include "firmware/link/fault_memory.hpp"
#include "firmware/link/link_types.hpp"
#include "firmware/link/parameters.hpp"
#include "hal/id_filters.hpp"

namespace esmc::link {

/// The controller's end of the interface to a supervisor computer.
class CommandLink {
 public:
  CommandLink() = default;
  explicit CommandLink(const LinkConfig& c)
      : config_(c), parameters_(c.parameters), session_(c.session), source_(c.source) {}

  [[nodiscard]] bool active() const { return config_.base_id != 0; }  ///< false: every frame is not_mine
  /// Adds the identifiers of the link, in both directions.
  void add_filters(hal::IdFilters& list) const {
    if (active()) list.add({config_.base_id, 0x7FF & ~(block_size - 1U), false});
  }
  [[nodiscard]] const Parameters& parameters() const { return parameters_; }  ///< with present gains
  [[nodiscard]] const Counters& counters() const { return counters_; }        ///< of received frames
  [[nodiscard]] std::uint8_t session() const { return session_; }      ///< 1..255, part of every checksum
  [[nodiscard]] std::uint32_t scene() const { return config_.scene; }  ///< LinkConfig::scene

  /// Counts a tick, which ages of frames refer to; call before the frames of the tick. An order carries 16
  /// bits of the tick: unless armed, the session changes more often than they repeat, and an order of the one
  /// before is valid for as long as the Status that it answers.
  void begin_tick() {
    ++tick_;
    if (grace_ > 0) --grace_;
    if (tick_ % session_ticks != 0 || armed()) return;
    next_session();
    grace_ = config_.command_age_ticks_max;
    status_due_ = true;
  }

  /// Checks a frame, stores its request for take(), and counts the outcome. `waited`: ticks from its arrival
  /// to this call, below 2^31. `reachable`: whether the mechanism has a pose at the position of a set point
  /// (finite); where not, the frame is refused and has no effect.
  Outcome receive(const hal::CanFrame& f, std::uint32_t waited = 0) {
    return receive(f, waited, [](const std::array<float, 2>&) { return true; });
  }
  template <class Reachable>
  Outcome receive(const hal::CanFrame& f, std::uint32_t waited, Reachable&& reachable) {
    waited_ticks_ = waited;
    if (!active() || f.extended || f.id - config_.base_id >= block_size) return Outcome::not_mine;
    const auto m = static_cast<std::uint8_t>(f.id - config_.base_id);
    if (m >= outgoing_first) return f.remote ? Outcome::not_mine : Outcome::foreign_command;
    const Outcome o = m < incoming_count ? judge(f, m, reachable) : Outcome::malformed;
    count(o);
    return o;
  }

  /// Returns the requests since the last call and clears them; `source` is the present one in any case.
  [[nodiscard]] Request take() {
    Request r = request_;
    request_ = {};
    r.source = source_;
    return r;
  }
  /// Takes stored gains at power-up, before the first tick, for the next take(). False: refused, no effect.
  bool restore(const Gains& g) {
    const bool good = parameters_.restore(g);
    if (good) request_.has_gains = true;
    return good;
  }
  /// Returns the last request to the store since the last call, and clears it.
  [[nodiscard]] StoreRequest take_store_request() {
    return std::exchange(store_request_, StoreRequest::none);
  }
  /// Sets the status of the store, which is sent when it changes. Without a call there is no store.
  void store_status(const StoreStatus& s) {
    slots_due_ = slots_due_ || s != store_;
    store_ = s;
  }
  /// Records the ticks from now on in this memory (Capture), which must outlive the link; by default none.
  void capture_into(std::span<CaptureRecord> memory) { capture_ = Capture(memory); }
  /// Sets the lateness of the coming tick for its record, us.
  void late_by(std::uint32_t us) { lateness_us_ = us; }
  void offer_homing(bool offered) { homes_ = offered; }         ///< sets whether `home` is obeyed
  void zero_unknown(bool unknown) { zero_unknown_ = unknown; }  ///< sets Status::zero_unknown
  /// Counts a refused frame: the caller could not follow an order that take() gave.
  void refuse() { count(Outcome::refused); }

  /// True if no sign of life, which is a Command in order, no older than `order_age`, or an obeyed set point
  /// or sample, came for more than `silence` ticks (0: not checked) in an armed state, or no sample of a
  /// begun stream for more than `stream_age` ticks. While an unattended reference runs and is not held, no
  /// sign of life is needed.
  [[nodiscard]] bool lost() const {
    const auto silence = static_cast<std::uint32_t>(parameters_[Index::silence]);
    const bool alone =
        config_.unattended && source_ == Source::reference && state_ >= State::running && !held_;
    return (armed() && !alone && silence > 0 && tick_ - heard_tick_ > silence) ||
           (streaming_ && over_age(sample_age()));
  }

  /// Sends at most one due frame, at the end of every tick, so that the link never delays another frame by
  /// more than that: a new state or fault, or else an answer, or else the other kinds in turn. `send` returns
  /// whether the bus took the frame; if not, it is tried again.
  template <class Send>
  void transmit(const Supervisor& s, const Report& r, Send&& send) {
    change_state(s.state());
    if (capture_.active()) capture(s, r);
    faults_.update(s, static_cast<std::uint32_t>(tick_ * config_.period_ns / 1000U), r);
    status_due_ = due(since_status_, config_.status_ticks) || status_due_;
    if (due(since_telemetry_, config_.telemetry_ticks) && unsent_ == 0) {
      telemetry_report_ = r;
      unsent_ = telemetry_first + r.joints;
    }
    if (due(since_table_, config_.table_ticks)) {
      table_due_ = counters_due_ = identity_due_ = true;
      slots_due_ = slots_due_ || store_.state != StoreState::none;
    }
    const bool changed = s.state() != sent_state_ || s.fault() != sent_fault_;
    if (changed) {
      status_due_ = true;
      turn_ = 0;
    }
    answered_ = !changed && !answered_ && answer(send);
    if (answered_) return;
    for (unsigned n = 0; n < kinds; ++n) {
      const unsigned kind = turn_;
      turn_ = (turn_ + 1) % kinds;
      if (offer(kind, s, send)) return;
    }
    answered_ = answer(send);
  }

 private:
  static constexpr std::uint8_t counter_never = 0xFF;
  static constexpr unsigned telemetry_first = 2;  // effector and tracking error, then the joints

  // ---- to the controller

  template <class Reachable>
  Outcome judge(const hal::CanFrame& f, std::uint8_t m, Reachable& reachable) {
    if (f.size != 8 || f.remote || f.fd) return Outcome::malformed;
    const auto message = static_cast<Message>(m);
    const bool of_before = !intact(f, session_) && waited_ticks_ < grace_ && intact(f, before(session_));
    if (!of_before && !intact(f, session_)) {
      return message == Message::command && intact(f, any_session) ? without_session(f) : Outcome::bad_crc;
    }
    const bool in_order = ahead(m, counter_of(f));
    const Outcome o = obey(f, message, in_order, of_before, reachable);
    if (in_order && o != Outcome::malformed) last_[m] = counter_of(f);
    return o;
  }
  template <class Reachable>
  Outcome obey(const hal::CanFrame& f, Message message, bool in_order, bool of_before, Reachable& reachable) {
    if (message == Message::command) {
      const auto c = decode_command(f);
      if (!c) return Outcome::malformed;
      // Even if the order is refused below; not a frame that something on its way has kept.
      if (in_order && age_of(*c) <= config_.command_age_ticks_max) heard_tick_ = tick_;
      // An order that takes torque away needs no counter.
      return in_order || takes_away(c->order) ? order(*c, of_before) : Outcome::bad_counter;
    }
    if (!in_order) return Outcome::bad_counter;
    switch (message) {
      case Message::set_point:
        return alive_if_obeyed(set_point(decode_pair(f, position_unit), reachable));
      case Message::stream_position:
        return position(f);
      case Message::stream_velocity:
        return alive_if_obeyed(velocity(f));
      case Message::parameter_write:
        return write(decode_parameter_write(f));
      default:
        return answer_to(decode_request(f));
    }
  }
  /// Only obeyed motion is a sign of life; requests, writes and refused frames are not.
  Outcome alive_if_obeyed(Outcome o) {
    if (o == Outcome::obeyed) heard_tick_ = tick_;
    return o;
  }
  /// The alive counter has advanced by 1 to counter_jump_max.
  [[nodiscard]] bool ahead(std::uint8_t m, std::uint8_t counter) const {
    const unsigned step = (counter - last_[m]) & 0x0FU;
    return last_[m] == counter_never || (step >= 1 && step <= config_.counter_jump_max);
  }
  static bool takes_away(Order o) { return o == Order::disarm || o == Order::off; }

  /// From a sender without the session: only orders that take torque away.
  Outcome without_session(const hal::CanFrame& f) {
    const auto c = decode_command(f);
    if (!c || !takes_away(c->order)) return Outcome::refused;
    return order(*c);
  }

  /// Ticks since the Status that the frame answers.
  [[nodiscard]] std::uint16_t age_of(const CommandFrame& c) const {
    return static_cast<std::uint16_t>(tick_ - c.tick);
  }
  /// `of_before`: it has the session before, so its Status must have had that one, too.
  Outcome order(const CommandFrame& c, bool of_before = false) {
    if (c.order == Order::none) return Outcome::obeyed;
    if (takes_away(c.order)) {
      // A disarm does not replace an off of the same tick.
      if (request_.command != Command::stop) {
        request_.command = c.order == Order::off ? Command::stop : Command::halt;
      }
      return Outcome::obeyed;
    }
    const std::uint16_t age = age_of(c);
    if (age + waited_ticks_ > config_.command_age_ticks_max) return Outcome::refused;
    if (of_before && age <= config_.command_age_ticks_max - grace_) return Outcome::refused;
    if (request_.command != Command::none) return Outcome::refused;
    const bool disabled = state_ == State::disabled;
    switch (c.order) {
      case Order::arm:
      case Order::home:
        if (!disabled || storing() || !known_table(c)) return Outcome::refused;
        if (c.order == Order::home && !homes_) return Outcome::refused;
        request_.command = c.order == Order::home ? Command::home : Command::enable;
        return Outcome::obeyed;
      case Order::store:
        return known_table(c) ? keep(StoreRequest::store) : Outcome::refused;
      case Order::forget:
        return keep(StoreRequest::forget);
      case Order::reset:
        request_.command = Command::reset;
        return Outcome::obeyed;
      case Order::confirm_zero:
        if (!disabled) return Outcome::refused;
        request_.command = Command::confirm_zero;
        return Outcome::obeyed;
      case Order::hold:
        return hold();
      case Order::override:
        return pace(c.percent);
      case Order::resume:
        return held_ ? pace(percent_) : Outcome::refused;
      default:
        if (c.order == Order::stream && guided()) {
          ended_ = false;
          return Outcome::obeyed;
        }
        if (!disabled) return Outcome::refused;
        source_ = c.order == Order::stream ? Source::stream : Source::reference;
        return Outcome::obeyed;
    }
  }
  /// The operator's program has seen the table that it arms or stores.
  [[nodiscard]] bool known_table(const CommandFrame& c) const {
    return c.parameters == static_cast<std::uint16_t>(parameters_.crc());
  }
  /// Meanwhile neither arming nor writing is possible: the stored table stays consistent, and no tick with
  /// torque is slowed by the flash (an STM32G4 has no data cache then).
  [[nodiscard]] bool storing() const {
    return store_.state == StoreState::storing || store_.state == StoreState::forgetting ||
           store_.memory_busy;
  }
  Outcome keep(StoreRequest request) {
    if (state_ != State::disabled || storing() || store_.state == StoreState::none) return Outcome::refused;
    store_request_ = request;
    StoreStatus s = store_;
    s.state = request == StoreRequest::store ? StoreState::storing : StoreState::forgetting;
    store_status(s);
    if (request == StoreRequest::forget) {
      parameters_ = config_.parameters;
      request_.has_gains = table_due_ = counters_due_ = true;
    }
    return Outcome::obeyed;
  }
  Outcome hold() {
    if (state_ == State::disabled) {
      source_ = Source::hold;
      return Outcome::obeyed;
    }
    if (!guided()) return pace(0);
    end_stream();
    request_.has_point = request_.has_sample = false;
    request_.hold = true;
    return Outcome::obeyed;
  }
  /// The reference along its path: a percentage of its speed, also for the next start; 0: hold, only while
  /// it leads, which an order of the same tick does not undo.
  Outcome pace(std::uint8_t percent) {
    const bool leads = state_ == State::running && source_ == Source::reference;
    if (!config_.has_path || !(leads || (state_ == State::disabled && percent > 0))) return Outcome::refused;
    if (request_.has_rate && request_.percent == 0) return Outcome::refused;
    held_ = percent == 0;
    if (!held_) percent_ = percent;
    request_.has_rate = true;
    request_.percent = percent;
    return Outcome::obeyed;
  }
  /// Set points and samples are accepted.
  [[nodiscard]] bool guided() const { return state_ == State::running && source_ == Source::stream; }

  [[nodiscard]] bool within(const std::array<float, 2>& p) const {
    bool in = true;
    for (unsigned i = 0; i < 2; ++i)
      in = in && p[i] >= config_.position[i].lower && p[i] <= config_.position[i].upper;
    return in;
  }
  /// |coordinate| <= most.
  static bool below(const std::array<float, 2>& v, float most) {
    return v[0] <= most && -v[0] <= most && v[1] <= most && -v[1] <= most;
  }
  static std::array<float, 2> difference(const std::array<float, 2>& a, const std::array<float, 2>& b) {
    return {a[0] - b[0], a[1] - b[1]};
  }

  template <class Reachable>
  Outcome set_point(const std::optional<Pair>& p, Reachable& reachable) {
    if (!p) return Outcome::malformed;
    if (!guided() || p->space != config_.space || !within(p->value)) return Outcome::refused;
    if (!reachable(p->value)) return Outcome::refused;
    end_stream();
    request_.hold = request_.has_sample = false;
    request_.has_point = true;
    request_.position = p->value;
    return Outcome::obeyed;
  }

  /// What is left of it is refused, until no sample has come for stream_age ticks or Order::stream announces
  /// another: an order counts also where a second computer goes on to stream.
  void end_stream() {
    ended_ = ended_ || streaming_;
    streaming_ = half_ = false;
  }
  [[nodiscard]] std::uint64_t sample_age() const { return tick_ - sample_tick_; }
  [[nodiscard]] bool over_age(std::uint64_t age) const {
    return age > static_cast<std::uint32_t>(parameters_[Index::stream_age]);
  }
  /// First half of a sample; its velocity follows with the same counter.
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
    if (!guided() || !whole || !below(v->value, parameters_[Index::speed])) return Outcome::refused;
    ended_ = ended_ && !over_age(sample_age());
    if (ended_) {
      sample_tick_ = tick_;
      return Outcome::refused;
    }
    if (!continuous(v->value)) return Outcome::refused;
    streaming_ = true;
    sample_tick_ = tick_;
    request_.hold = request_.has_point = false;
    request_.has_sample = true;
    request_.position = last_position_ = half_position_;
    request_.velocity = last_velocity_ = v->value;
    return Outcome::obeyed;
  }
  /// Reachable from the previous sample with speed and acceleration in the ticks since then. Samples may come
  /// up to `ahead_ticks_max` late and then all at once, but on the whole no faster than the limits.
  [[nodiscard]] bool continuous(const std::array<float, 2>& v) {
    if (!streaming_) {  // the first one is joined
      spare_ticks_ = ahead_ticks_max;
      return true;
    }
    const float h = parameters_[Index::sample_time];
    const auto moved = difference(half_position_, last_position_), faster = difference(v, last_velocity_);
    float needed = 0.0F;  // ticks
    for (unsigned i = 0; i < 2; ++i) {
      needed =
          larger(needed, (larger(moved[i], -moved[i]) - position_unit) / (parameters_[Index::speed] * h));
      needed = larger(
          needed, (larger(faster[i], -faster[i]) - velocity_unit) / (parameters_[Index::acceleration] * h));
    }
    const float left = static_cast<float>(sample_age()) + spare_ticks_ - needed;
    if (!(left >= 0.0F)) return false;
    spare_ticks_ = left < ahead_ticks_max ? left : ahead_ticks_max;
    return true;
  }
  static float larger(float a, float b) { return a > b ? a : b; }

  Outcome write(const std::optional<ParameterWrite>& w) {
    if (!w) return Outcome::malformed;
    const Answer a = parameters_.write(
        w->index, w->value,
        state_ == State::disabled && !storing() && request_.command != Command::enable);  // armed as seen
    queue_answer(w->index, a);
    if (a != Answer::ok) return Outcome::refused;
    request_.has_gains = table_due_ = counters_due_ = true;
    return Outcome::obeyed;
  }
  Outcome answer_to(const std::optional<RequestFrame>& q) {
    if (!q) return Outcome::malformed;
    switch (q->subject) {
      case Subject::faults:
        faults_.read_out();
        break;
      case Subject::capture:
        capture_.read(q->index);
        break;
      case Subject::table:
        table_due_ = counters_due_ = identity_due_ = slots_due_ = true;
        break;
      default:
        queue_answer(q->index, q->index < parameter_count ? Answer::ok : Answer::unknown_index);
        break;
    }
    return Outcome::obeyed;
  }

  /// One answer per parameter waits, and one for an index that there is not.
  void queue_answer(std::uint8_t index, Answer a) {
    if (index >= parameter_count) unknown_index_ = index;
    const unsigned at = index < parameter_count ? index : parameter_count;
    answers_[at] = a;
    answers_due_ |= 1U << at;
  }

  void count(Outcome o) {
    std::uint16_t& n = o == Outcome::obeyed        ? counters_.obeyed
                       : o == Outcome::bad_crc     ? counters_.bad_crc
                       : o == Outcome::bad_counter ? counters_.bad_counter
                                                   : counters_.refused;
    ++n;
  }

  // ---- from the controller

  /// True once in `ticks` calls; never if 0. A remainder of tick_ would cost a division of 64 bits.
  static bool due(std::uint32_t& passed, std::uint32_t ticks) {
    if (++passed < ticks || ticks == 0) return false;
    passed = 0;
    return true;
  }

  [[nodiscard]] bool armed() const {
    return state_ != State::disabled && state_ != State::stopping && state_ != State::fault;
  }
  void next_session() { session_ = session_ == 0xFF ? 1 : session_ + 1; }
  static std::uint8_t before(std::uint8_t session) { return session == 1 ? 0xFF : session - 1; }

  /// A new session begins when the controller becomes disabled, so that recorded frames are refused later.
  void change_state(State now) {
    if (now == State::disabled && state_ != State::disabled) {
      next_session();
      grace_ = 0;
    }
    if (now != State::running) {
      streaming_ = half_ = ended_ = false;
      if (held_) request_.has_rate = true, request_.percent = percent_;
      held_ = false;
    }
    if (state_ == State::disabled) heard_tick_ = tick_;
    state_ = now;
  }
  /// Records a tick.
  [[gnu::noinline]] void capture(const Supervisor& s, const Report& r) {
    const std::uint32_t refused = 0U + counters_.bad_crc + counters_.bad_counter + counters_.refused;
    const unsigned second = r.joints / 2U;  // base joint among the joints with a motor
    capture_.record({static_cast<std::uint32_t>(tick_),
                     lateness_us_,
                     s.state(),
                     s.fault(),
                     counters_.obeyed != obeyed_,
                     refused != refused_,
                     {r.angle[0], r.angle[second]},
                     {r.torque[0], r.torque[second]},
                     {parameters_[Index::torque_limit_1], parameters_[Index::torque_limit_2]},
                     r.error});
    obeyed_ = counters_.obeyed;
    refused_ = refused;
  }
  [[nodiscard]] Status status(const Supervisor& s) const {
    const Reacted reacted = s.fault() == Fault::none    ? Reacted::none
                            : s.state() == State::fault ? Reacted::zero_torque
                                                        : Reacted::halt;
    const Pace pace = held_ ? Pace::held : percent_ < 100 ? Pace::reduced : Pace::full;
    return {s.state(), s.fault(), reacted,      source_, streaming_, static_cast<std::uint32_t>(tick_),
            session_,  pace,      zero_unknown_};
  }
  // Each offers the bus a frame if one is due, and returns whether it was.
  template <class Send, class Frame>
  static bool once(bool& is_due, Send&& send, Frame&& frame) {
    if (!is_due) return false;
    is_due = !send(frame());
    return true;
  }
  template <class Send>
  bool answer(Send&& send) {
    if (answers_due_ == 0) {
      return once(table_due_, send, [&] {
        return encode_parameter_table(config_.base_id, parameters_.crc(), parameter_count);
      });
    }
    const auto at = static_cast<std::uint8_t>(std::countr_zero(answers_due_));
    const bool known = at < parameter_count;
    const std::uint8_t index = known ? at : unknown_index_;
    if (send(encode_parameter_value(config_.base_id, index, answers_[at], parameters_.writable(index),
                                    known ? parameters_.at(at) : 0.0F)))
      answers_due_ &= answers_due_ - 1U;
    return true;
  }
  template <class Send>
  bool offer(unsigned kind, const Supervisor& s, Send&& send) {
    const std::uint32_t base = config_.base_id;
    switch (kind) {
      case 0:
        if (!once(status_due_, send, [&] { return encode_status(base, status(s), ++counter_); }))
          return false;
        if (!status_due_) sent_state_ = s.state(), sent_fault_ = s.fault();
        return true;
      case 1:
        return faults_.transmit(base, s.fault(), send);
      case 2:
        return telemetry(send);
      case 3:
        return once(counters_due_, send, [&] { return encode_counters(base, counters_); });
      case 4:
        return once(identity_due_, send,
                    [&] { return encode_identity(base, config_.scene, config_.unattended); });
      case 5:
        return capture_.transmit(base, send);
      default:
        return once(slots_due_, send, [&] { return encode_parameter_slots(base, store_); });
    }
  }
  template <class Send>
  bool telemetry(Send&& send) {
    if (unsent_ == 0) return false;
    const unsigned done = telemetry_first + telemetry_report_.joints - unsent_;
    const auto m = static_cast<std::uint8_t>(static_cast<unsigned>(Message::effector) + done);
    const auto& pair = done == 0 ? telemetry_report_.effector : telemetry_report_.error;
    const bool sent =
        done < telemetry_first
            ? send(encode_floats(config_.base_id, m, pair[0], pair[1]))
            : send(encode_floats(config_.base_id, m, telemetry_report_.angle[done - telemetry_first],
                                 telemetry_report_.torque[done - telemetry_first]));
    if (sent) --unsent_;
    return true;
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
  std::uint32_t waited_ticks_ = 0;                        // of the present frame
  static constexpr std::uint64_t session_ticks = 0x8000;  // half of the ticks that an order tells apart
  std::uint8_t session_ = 1;
  std::uint16_t grace_ = 0;   // ticks for which the session before is valid
  std::uint8_t counter_ = 0;  // of Status
  Source source_ = Source::reference;
  bool homes_ = false, zero_unknown_ = false;
  State state_ = State::disabled, sent_state_ = State::disabled;
  Fault sent_fault_ = Fault::none;
  bool streaming_ = false;      // the last motion request was a sample
  bool ended_ = false;          // the last stream, by an order; its samples may still come
  bool half_ = false;           // a position waits for its velocity
  bool held_ = false;           // the reference, on its path
  std::uint8_t percent_ = 100;  // of its speed, when it is not held
  std::uint8_t half_counter_ = 0;
  std::array<float, 2> half_position_{}, last_position_{}, last_velocity_{};
  static constexpr float ahead_ticks_max = 10.0F;
  float spare_ticks_ = 0.0F;            // that the samples of a stream have taken less than passed
  static constexpr unsigned kinds = 7;  // of offer()
  unsigned turn_ = 0;                   // the kind that is offered first
  bool answered_ = false;               // the last frame was one
  bool status_due_ = false, table_due_ = false, counters_due_ = false, slots_due_ = false;
  bool identity_due_ = true;  // sent at power-up without a request
  std::uint32_t since_status_ = 0, since_telemetry_ = 0, since_table_ = 0;
  std::uint32_t answers_due_ = 0;  // bit i: answers_[i]
  std::array<Answer, parameter_count + 1> answers_{};
  std::uint8_t unknown_index_ = 0;
  StoreStatus store_{};
  StoreRequest store_request_ = StoreRequest::none;
  Report telemetry_report_{};  // of the tick whose telemetry is being sent
  unsigned unsent_ = 0;        // frames of it
  Capture capture_{};
  std::uint32_t lateness_us_ = 0;
  std::uint16_t obeyed_ = 0;   // the counter at the record before
  std::uint32_t refused_ = 0;  // the sum of the others, likewise
};

static_assert(std::is_trivially_copyable_v<CommandLink>);
static_assert(state_count <= 16 && fault_count <= 255, "fields of Status");

}  // namespace esmc::link
