/// The loop of the boards against the clock: the cycle with ODrives, or a node of the target's own whose
/// samples are asked for, under any clock of 32 bits. Where the instants are the target computes in 64 bits.

#include <cmath>
#include <deque>

#include "boards/node.hpp"
#include "firmware/cycle/cycle.hpp"
#include "firmware/drive/odrive_axis.hpp"
#include "tests/fuzz/bytes.hpp"
#include "tests/fuzz/cycle_table.hpp"
#include "tests/support/board_double.hpp"
#include "tests/support/cycle_setup.hpp"
#include "tests/support/odrive_bytes.hpp"

namespace {

using namespace esmc;
using fuzz::Bytes;
using fuzz::require;
using hal::CanFrame;
using M = Rr<float>;
using OdriveCycle = Cycle<M, drive::OdriveAxis>;

struct ClockBus {
  std::deque<CanFrame> waiting;
  std::vector<CanFrame> sent;
  hal::SendStatus status = hal::SendStatus::ok;
  bool is_off = false;
  unsigned withdrawn = 0, rejoined = 0;

  hal::SendStatus try_send(const CanFrame& f) {
    require(hal::well_formed(f), "only well-formed frames are sent");
    sent.push_back(f);
    return is_off ? hal::SendStatus::bus_off : status;
  }
  bool try_receive(CanFrame& f) {
    if (waiting.empty()) return false;
    f = waiting.front();
    waiting.pop_front();
    return true;
  }
  void withdraw() {
    require(sent.empty(), "what is old is withdrawn before anything is sent");
    ++withdrawn;
  }
  void rejoin() { ++rejoined; }
  [[nodiscard]] bool off() const { return is_off; }
};
using ClockBoard = test::BoardDouble<ClockBus>;

/// A node that asks for its samples. What it says of itself is the input's.
struct AskingNode {
  static constexpr bool samples_on_demand = true;
  bool whole = false, flooded = false, healthy = true, powered = false, brakes = false, closed = true;
  unsigned requests = 0, late = 0, taken = 0;

  void enable_input(bool v) { closed = v; }
  void receive(ClockBus&) { ++taken; }
  [[nodiscard]] bool complete() const { return whole; }
  [[nodiscard]] bool overloaded() const { return flooded; }
  void request(ClockBus& bus) {
    ++requests;
    require(bus.try_send({.id = 0x080}) != hal::SendStatus::refused, "a request is a frame");
  }
  bool tick(ClockBus&, bool answer) { return answer; }
  void tick_late() { ++late; }
  [[nodiscard]] bool output_ok() const { return healthy; }
  [[nodiscard]] bool drive_enable() const { return powered; }
  [[nodiscard]] bool release_brake() const { return brakes; }
};

/// The cycle with two drives that obey. Their joints rest.
struct RealNode : OdriveCycle {
  using OdriveCycle::OdriveCycle;
  unsigned requests = 0, late = 0;
  bool answers = false;
  void request(ClockBus&) { ++requests; }
  void tick_late() {
    ++late;
    OdriveCycle::tick_late();
  }
  TickResult<M> tick(ClockBus& bus, bool answer) {
    answers = answer;
    return OdriveCycle::tick(bus, answer);
  }
};

RealNode real_node() {
  const auto s = test::setup<M>();
  OdriveCycle::Config c;
  c.controller = s.controller;
  for (std::size_t i = 0; i < 2; ++i) {
    const test::Mounting& m = test::mountings[i];
    c.axes[i] = drive::OdriveAxis(
        {m.node, static_cast<float>(m.direction), static_cast<float>(m.gear), static_cast<float>(m.offset)},
        s.version, 8);
  }
  c.heartbeat_age_ticks_max = s.heartbeat_age_ticks_max;
  return RealNode(c);
}

template <class Node>
class ClockRun {
 public:
  ClockRun(Bytes& in, const Node& node)
      : in_(in),
        node_(node),
        board_{.now = in.u32()},
        period_ns_(choose_period()),
        patience_(static_cast<float>(in.below(101)) / 100.0F),
        loop_(node_, board_, period_ns_, patience_),
        next_ns_(std::uint64_t{board_.now} * 1000),
        rejoined_us_(board_.now) {}

  void go() {
    for (int steps = 0; !in_.empty() && steps < 400; ++steps) {
      change();
      pass();
      for (unsigned n = 1 + in_.below(3); n > 0; --n) turn();
    }
  }

 private:
  std::uint32_t choose_period() {
    const unsigned which = in_.below(4);
    return which == 0   ? 1'000'000
           : which == 1 ? 333'333
           : which == 2 ? 1'000'500
                        : 100'000 + in_.u32() % 999'900'001U;
  }

  void pass() {
    in_.one_of(
        10,
        [&] {
          // it stands still
        },
        [&] { board_.now += in_.u8(); }, [&] { board_.now += in_.u16(); }, [&] { board_.now += in_.u32(); },
        [&] { board_.now -= in_.u16(); }, [&] { board_.now = loop_.instant_us() - 1; },
        [&] { board_.now = loop_.instant_us() + period_ns_ / 2000 + in_.below(2); },
        [&] { board_.now = loop_.instant_us(); });
  }
  void change();

  void turn() {
    const std::uint32_t now = board_.now, instant = loop_.instant_us(), late_before = loop_.late();
    const unsigned refreshed = board_.dog.refreshed, withdrawn = board_.bus_.withdrawn,
                   requests = node_.requests, told_late = node_.late, rejoined = board_.bus_.rejoined;
    board_.bus_.sent.clear();
    powered_before_ = node_.drive_enable();
    const bool ticked = loop_.turn([&](const auto& result) { judge(result); });
    const bool begun = board_.bus_.withdrawn != withdrawn;
    require(!(ticked && begun), "one thing a turn");
    const std::uint32_t ahead =
        instant - now;  // a period at most, and another for a clock that jitters: what is more is late
    const bool due = ahead == 0 || ahead > 2U * (period_ns_ / 1000U) + 1U;
    // A clock that goes back behind the begin of a tick may end it at once.
    const bool went_back = asked_ && now - began_us_ >= 0x8000'0000U;
    if (!ready() && !went_back) require(due || !(ticked || begun), "nothing before its instant");
    if (due && now - began_at() < 0x8000'0000U) require(ticked || begun, "and something at it");
    if (begun) {
      require(!asked_ && board_.bus_.withdrawn == withdrawn + 1, "a tick begins once");
      begin(now, late_before, told_late);
      require(node_.requests == requests + (Node::samples_on_demand ? 1 : 0),
              "samples are asked for where they must be");
    } else {
      require(node_.requests == requests && node_.late == told_late && loop_.late() == late_before,
              "and only then");
    }
    rejoin(begun, now, board_.bus_.rejoined - rejoined);
    if (ticked) {
      require(asked_, "a tick that has begun");
      asked_ = false;
      next_ns_ += period_ns_;
      require(board_.power.on == node_.drive_enable() && board_.brake_.on == node_.release_brake(),
              "pins as the node says");
    }
    require(board_.dog.refreshed == refreshed + (ticked && node_.output_ok() ? 1 : 0),
            "the watchdog is fed by good ticks only");
    if (!ticked && !(begun && Node::samples_on_demand))
      require(board_.bus_.sent.empty(), "frames are of ticks");
  }
  [[nodiscard]] std::uint32_t began_at() const {
    return asked_ ? began_us_ : static_cast<std::uint32_t>(next_ns_ / 1000);
  }
  /// A set is there before the patience is over.
  [[nodiscard]] bool ready() const {
    return asked_ && (!Node::samples_on_demand || node_.complete() || node_.overloaded());
  }

  void begin(std::uint32_t now, std::uint32_t late_before, unsigned told_late) {
    const std::uint32_t since = now - static_cast<std::uint32_t>(next_ns_ / 1000),
                        period_us = period_ns_ / 1000;
    const bool late = since > period_us / 2, by_far = since >= 50'000 && since / 10 >= period_us;
    require(loop_.late() == late_before + (late ? 1 : 0) && loop_.lateness_us() == since,
            "late ticks are counted");
    ++tick_;
    while (!late_at_.empty() && late_at_.front() + 64 <= tick_) late_at_.pop_front();
    const bool in_a_row = !late_at_.empty() && late_at_.back() + 1 == tick_;
    too_late_ = late && (in_a_row || late_at_.size() >= 3 || by_far);
    require(node_.late == told_late + (too_late_ ? 1 : 0),
            "two in a row, four of 64 and one by far are told");
    if (late) late_at_.push_back(tick_);
    if (late) next_ns_ += std::uint64_t{since} * 1000;
    began_us_ = now;
    asked_ = true;
  }
  /// Five times a second at most, and only where the bus was left.
  void rejoin(bool begun, std::uint32_t now, unsigned times) {
    const bool off = board_.bus_.is_off;
    require(times <= (begun && off ? 1 : 0), "a bus that was not left is not rejoined, nor between ticks");
    if (times != 0) require(now - rejoined_us_ >= 200'000, "not at every tick");
    if (begun && off && now - rejoined_us_ >= 200'000) require(times == 1, "but five times a second");
    if (begun && (!off || times != 0)) rejoined_us_ = now;
  }

  template <class Result>
  void judge(const Result& r);

  Bytes& in_;
  Node node_;
  ClockBoard board_;
  std::uint32_t period_ns_;
  float patience_;
  TimedLoop<Node, ClockBoard> loop_;
  std::uint64_t next_ns_;
  std::uint32_t rejoined_us_, began_us_ = 0;
  std::uint64_t tick_ = 0;
  std::deque<std::uint64_t> late_at_;  // ticks of the last 64
  bool asked_ = false, too_late_ = false, armed_ = false, powered_before_ = false, latched_ = false;
  std::array<std::uint8_t, 2> state_{test::axis_closed_loop, test::axis_closed_loop};
  bool reset_ = false;
};

template <>
void ClockRun<AskingNode>::change() {
  const unsigned how = in_.u8();
  node_.whole = (how & 1U) != 0;
  node_.flooded = (how & 0x0EU) == 0x0EU;
  node_.healthy = (how & 0x70U) != 0x70U;
  node_.powered = (how & 0x80U) != 0;
  node_.brakes = (how & 6U) == 6U;
  board_.contact.on = (how & 0x30U) != 0x30U;
  board_.bus_.is_off = (how & 0x48U) == 0x48U;
}
template <>
template <>
void ClockRun<AskingNode>::judge(const bool& answered) {
  armed_ = armed_ || powered_before_;
  require(answered == armed_, "no torque before it was armed, and an answer ever after");
  require(node_.closed == board_.contact.on, "the contact as it is");
}

/// What the drives say, and the operator; then what the bus does.
template <>
void ClockRun<RealNode>::change() {
  const unsigned how = in_.u8();
  reset_ = reset_ && asked_;
  if ((how & 3U) != 3U) {
    const auto angle = test::setup<M>().angle;
    for (std::size_t i = 0; i < 2; ++i) {
      const test::Mounting& m = test::mountings[i];
      if ((how & 4U) == 0) board_.bus_.waiting.push_back(test::heartbeat(m.node, state_[i]));
      board_.bus_.waiting.push_back(test::encoder(
          m.node, static_cast<float>((angle[i] - m.offset) * m.direction * m.gear / test::turn), 0.0F));
    }
  }
  switch (how >> 3U) {
    case 1:
      node_.command(Command::enable);
      break;
    case 2:
      node_.command(Command::reset);
      reset_ = true;
      break;
    case 3:
      node_.command(Command::stop);
      break;
    case 4:
      board_.contact.on = in_.yes();
      break;
    case 5:
      board_.bus_.is_off = in_.yes();
      break;
    case 6:
      board_.bus_.status = in_.yes() ? hal::SendStatus::bus_full : hal::SendStatus::ok;
      break;
    case 7:
      board_.bus_.waiting.push_back(in_.frame());
      break;
    case 8:
      state_[in_.below(2)] = in_.u8();
      break;
    default:
      break;
  }
}
template <>
template <>
void ClockRun<RealNode>::judge(const TickResult<M>& r) {
  armed_ = armed_ || powered_before_;
  require(node_.answers == armed_, "no torque before it was armed, and an answer ever after");
  if (too_late_) {
    too_late_ = false;
    require(r.state != State::running && r.state != State::testing && r.state != State::enabling,
            "two late ticks in a row, or four of 64, end it");
    latched_ = latched_ || powered_before_;
  }
  if (r.state == State::disabled || reset_) latched_ = false;
  if (latched_)
    require(r.state != State::running && r.state != State::testing,
            "and it stays so until the operator's reset");
  require(board_.power.on == (r.state != State::disabled && r.state != State::fault),
          "drive_enable as the table has it");
  require(board_.brake_.on == fuzz::has_torque(r.state), "the brake is open under torque only");
  if (!board_.contact.on)
    require(r.state == State::fault || r.state == State::disabled, "an open contact ends it at once");
  std::array<int, 2> torques{};
  for (const CanFrame& f : board_.bus_.sent) {
    for (std::size_t i = 0; i < 2; ++i) {
      const test::Mounting& m = test::mountings[i];
      if (test::node_of(f) != m.node) continue;
      if (test::command_of(f) == test::cmd_axis_state)
        state_[i] = static_cast<std::uint8_t>(test::word(f, 0));
      if (test::command_of(f) != test::cmd_torque) continue;
      ++torques[i];
      const double joint = static_cast<double>(test::real(f, 0)) * m.gear;
      require(std::isfinite(joint) && std::fabs(joint) <= 3.0 * (1 + 1e-6), "a torque within its limit");
      if (!fuzz::has_torque(r.state)) require(joint == 0, "none where none may be");
    }
  }
  require(std::ranges::all_of(torques, [&](int n) { return n <= (node_.answers ? 1 : 0); }),
          "one torque for each motor, none before it was armed");
}

/// Under torque, with a bus and a clock that do what they must.
RealNode running() {
  RealNode node = real_node();
  ClockBoard board;
  TimedLoop<RealNode, ClockBoard> loop(node, board, 1'000'000);
  std::array<std::uint8_t, 2> state{test::axis_idle, test::axis_idle};
  const auto angle = test::setup<M>().angle;
  for (int tick = 0; tick < 100 && !node.supervisor().running(); ++tick) {
    for (std::size_t i = 0; i < 2; ++i) {
      const test::Mounting& m = test::mountings[i];
      board.bus_.waiting.push_back(test::heartbeat(m.node, state[i]));
      board.bus_.waiting.push_back(test::encoder(
          m.node, static_cast<float>((angle[i] - m.offset) * m.direction * m.gear / test::turn), 0.0F));
    }
    if (tick == 3) node.command(Command::enable);
    board.bus_.sent.clear();
    while (!loop.turn()) {
    }
    for (const CanFrame& f : board.bus_.sent) {
      for (std::size_t i = 0; i < 2; ++i) {
        const bool asks =
            test::node_of(f) == test::mountings[i].node && test::command_of(f) == test::cmd_axis_state;
        if (asks) state[i] = static_cast<std::uint8_t>(test::word(f, 0));
      }
    }
    board.now += 1000;
  }
  require(node.supervisor().running(), "obedient drives bring it to torque");
  return node;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const RealNode under_torque = running();
  Bytes in(data, size);
  in.one_of(
      4, [&] { ClockRun<AskingNode>(in, {}).go(); }, [&] { ClockRun<RealNode>(in, real_node()).go(); },
      [&] { ClockRun<RealNode>(in, under_torque).go(); });
  return 0;
}
