/// A board's loop, its FDCAN driver and the registers under it on a bus where every bit takes its time: two
/// drives that report by their own clocks, the link, other nodes. What `esmc check` promises of the torques
/// holds; a loop that is held up comes to rest under control.

#include <gtest/gtest.h>

#include <array>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "boards/node.hpp"
#include "hal/fdcan/fdcan.hpp"
#include "host_sim/bus/response.hpp"
#include "host_sim/bus/wire.hpp"
#include "host_sim/controller/axes_config.hpp"
#include "host_sim/drives/placed_axes.hpp"
#include "host_sim/scene/scene.hpp"
#include "tests/support/board_double.hpp"
#include "tests/support/fdcan_model.hpp"
#include "tests/support/odrive_bytes.hpp"

namespace esmc::test {
namespace {

using M = FiveBar<float>;
using Node = Cycle<M, drive::OdriveAxis>;

constexpr std::uint32_t foreign_id = 0x15, foreign_period_us = 200;
constexpr std::uint32_t turn_us = 20, tick_us = 90;  ///< the loop's turn while it waits, and with a tick

host::Scene scene_of(bool foreign) {
  std::string effects = "effects=[{type=\"bit_timing\"}";
  if (foreign) {
    effects += ", {type=\"babbling_node\", identifier=" + std::to_string(foreign_id) +
               ", rate_hz=5000.0, size=0, from=-1}";
  }
  return host::read_scene_text(
      std::string(host::starting_scene("five_bar")), "scene of a test",
      {"reference.type=\"hold\"", "initial.position=[0.0, 0.17]", "control.rate_hz=1000",
       "command={speed=0.1, acceleration=1.0, telemetry_ticks=5}", effects + "]"});
}

/// A classic frame that waits for the bus, and who offers it.
struct Offered {
  hal::CanFrame frame;
  std::size_t node;
};

/// One bit is one microsecond. The mechanism stands still under a brake.
template <class Part>
class LoadedBus {
 public:
  using Bus = hal::Fdcan<Part, FdcanModelAccess>;
  static constexpr std::uint32_t period_us = 1000;

  explicit LoadedBus(const host::Scene& scene, bool foreign)
      : scene_(scene),
        foreign_(foreign),
        reference_(host::make_reference<float>(scene, host::Pacing::realtime)),
        node(std::get<Node::Config>(host::make_cycle_config<M>(scene, host::Pacing::realtime, reference_))),
        board_{Bus(FdcanModelAccess{&model}), {}, {true}, {}, {}, 0},
        loop_(node, board_, period_us * 1000) {
    EXPECT_TRUE(board_.bus().open(80'000'000, 1'000'000, 0, node.filters()));
    model.handler = [this] { board_.bus().interrupt(); };
    for (const host::PlacedAxis& place : host::placed_axes(scene)) {
      places_.push_back(place);
      axes_.push_back(host::make_axis(scene_, place, false));
      axes_.back()->settle(angle(places_.size() - 1));
      reports_at_.push_back(137 + 61 * static_cast<std::uint32_t>(places_.size()));
    }
  }
  ~LoadedBus() {
    for (const std::string& w : model.wrong) ADD_FAILURE() << w;
  }

  void run(double seconds) {
    for (const auto end = now() + static_cast<std::uint32_t>(seconds * 1e6); now() < end;) turn();
  }
  /// One turn of the loop, then `busy_us` in which it does something else. True: it was a tick.
  bool turn(std::uint32_t busy_us = 0) {
    const bool ticked = loop_.turn();
    if (ticked) ticked_at_ = now();
    pass(busy_us > 0 ? busy_us : (ticked ? tick_us : turn_us));
    return ticked;
  }
  void arm() {
    run(0.3);
    node.command(Command::enable);
    run(1.0);
    ASSERT_EQ(node.supervisor().state(), State::running) << name(node.supervisor().fault());
    slowest.clear();
    torques = link_frames = foreign_frames = own_frames = 0;
    interrupts_before = model.interrupts;
    busy_bits = 0;
    began_ = now();
  }
  [[nodiscard]] Bus& bus() { return board_.bus(); }
  [[nodiscard]] std::uint32_t now() const { return board_.now; }
  [[nodiscard]] std::uint32_t passed() const { return now() - began_; }
  /// N m at the joints that the drives have now.
  [[nodiscard]] double torque() const {
    double sum = 0.0;
    for (const auto& axis : axes_) sum += std::abs(axis->joint_torque());
    return sum;
  }
  [[nodiscard]] std::uint32_t late() const { return loop_.late(); }

  std::map<std::uint32_t, std::uint32_t> slowest;  ///< us from the request to the last bit, by identifier
  std::uint32_t torques = 0, link_frames = 0, foreign_frames = 0, own_frames = 0, interrupts_before = 0,
                busy_bits = 0;
  FdcanModel model{std::is_same_v<Part, hal::fdcan::G4> ? FdcanModel::Chip::g4 : FdcanModel::Chip::h7};

 private:
  static constexpr std::size_t board_node = 100;

  [[nodiscard]] double angle(std::size_t i) const {
    return scene_.start_angle[static_cast<std::size_t>(places_[i].joint)];
  }
  /// The bus goes on for so long, and the interrupt with it; the loop does not.
  void pass(std::uint32_t us) {
    for (; us > 0; --us) {
      model.idle(1);
      ++board_.now;
      speak();
      if (flight_ && now() == ends_at_) finish();
      if (!flight_ && now() >= free_at_) begin();
    }
  }
  /// Drives by their own clocks, which are slow, so that their frames meet the tick's in every way; the other
  /// node, which is more urgent than all of them.
  void speak() {
    for (std::size_t i = 0; i < axes_.size(); ++i) {
      if (now() != reports_at_[i]) continue;
      reports_at_[i] += period_us + (++reports_[i] % (i == 0 ? 5 : 7) == 0 ? 1 : 0);
      axes_[i]->publish(angle(i), 0.0, [&](const hal::CanFrame& f) { offered_.push_back({f, i}); });
    }
    if (foreign_ && now() % foreign_period_us == 77) offered_.push_back({data(foreign_id, 0), axes_.size()});
  }
  static hal::CanFrame data(std::uint32_t id, std::uint8_t size) { return hal::data_frame(id, size); }

  void begin() {
    const auto own = model.begin_frame();
    auto best = offered_.end();
    for (auto f = offered_.begin(); f != offered_.end(); ++f) {
      if (best == offered_.end() || host::arbitration(f->frame) < host::arbitration(best->frame)) best = f;
    }
    if (!own && best == offered_.end()) return;
    if (own && best != offered_.end() && host::arbitration(best->frame) < host::arbitration(as_frame(*own))) {
      model.lost();
    } else if (own) {
      flight_ = Offered{as_frame(*own), board_node};
    }
    if (!flight_) {
      flight_ = *best;
      offered_.erase(best);
    }
    length_ = host::exact_bits(flight_->frame) - host::interframe_bits;
    ends_at_ = now() + length_;
    busy_bits += length_ + host::interframe_bits;
  }
  void finish() {
    const Offered f = *flight_;
    flight_.reset();
    free_at_ = now() + host::interframe_bits;
    if (f.node == board_node) {
      model.delivered();
      if (f.frame.id >= 0x780) ++link_frames;
      if (command_of(f.frame) == cmd_torque && f.frame.id < 0x780) {
        ++torques;
        slowest[f.frame.id] = std::max(slowest[f.frame.id], now() - ticked_at_);
      }
    } else {
      ++(f.node == axes_.size() ? foreign_frames : own_frames);
      model.deliver({f.frame.id,
                     f.frame.extended,
                     f.frame.remote,
                     false,
                     false,
                     f.frame.size,
                     {f.frame.data.begin(), f.frame.data.begin() + f.frame.size}},
                    length_);
    }
    for (std::size_t i = 0; i < axes_.size(); ++i) {
      if (i == f.node) continue;
      (void)axes_[i]->receive(f.frame, [&](const hal::CanFrame& reply) { offered_.push_back({reply, i}); });
    }
  }
  static hal::CanFrame as_frame(const WireFrame& w) {
    hal::CanFrame f{.id = w.id, .extended = w.extended, .remote = w.remote};
    for (const std::uint8_t b : w.bytes) f.data[f.size++] = b;
    return f;
  }

  host::Scene scene_;
  bool foreign_;
  host::ReferenceBundle<float> reference_;

 public:
  Node node;

 private:
  BoardDouble<Bus> board_;
  TimedLoop<Node, BoardDouble<Bus>> loop_;
  std::vector<host::PlacedAxis> places_;
  std::vector<std::unique_ptr<host::EmulatedAxis>> axes_;
  std::vector<std::uint32_t> reports_at_;
  std::array<std::uint32_t, 2> reports_{};
  std::uint32_t ticked_at_ = 0, began_ = 0, ends_at_ = 0, free_at_ = 0, length_ = 0;
  std::deque<Offered> offered_;
  std::optional<Offered> flight_;
};

template <class Part>
class FdcanLoad : public testing::Test {};
using Parts = testing::Types<hal::fdcan::G4, hal::fdcan::H7>;
TYPED_TEST_SUITE(FdcanLoad, Parts);

/// No torque is later than `esmc check` says, and none is withdrawn; frames of other nodes cost their bits.
TYPED_TEST(FdcanLoad, EveryTorqueIsWithinTheBoundOfCheck) {
  for (const bool foreign : {false, true}) {
    SCOPED_TRACE(foreign);
    const host::Scene scene = scene_of(foreign);
    LoadedBus<TypeParam> b(scene, foreign);
    b.arm();
    const double seconds = std::is_same_v<TypeParam, hal::fdcan::G4> ? 60.0 : 6.0;
    b.run(seconds);
    EXPECT_EQ(b.node.supervisor().state(), State::running) << name(b.node.supervisor().fault());
    EXPECT_NEAR(b.torques, 2000 * seconds, 2);
    EXPECT_GT(b.link_frames, 850 * seconds);
    EXPECT_LE(b.link_frames, 1000 * seconds + 1);
    EXPECT_EQ(b.bus().withdrawn(), 0U);
    EXPECT_EQ(b.bus().overruns(), 0U);
    EXPECT_EQ(b.late(), 0U);
    EXPECT_GT(b.torque(), 0.01) << "the weight";
    const host::BusAnalysis check = host::analyse_bus(scene);
    int bounded = 0;
    for (const auto& m : check.messages) {
      if (!b.slowest.contains(m.id)) continue;
      ASSERT_TRUE(m.response_s) << m.name;
      EXPECT_LE(b.slowest[m.id], *m.response_s * 1e6) << m.name;
      EXPECT_GE(b.slowest[m.id], 0.3 * *m.response_s * 1e6) << m.name << ": the bus is not loaded";
      ++bounded;
    }
    EXPECT_EQ(bounded, 2);
    EXPECT_LE(b.busy_bits, check.load * b.passed());
    // An interrupt per frame of ours at most, none for a frame of another node.
    EXPECT_EQ(b.foreign_frames > 0, foreign);
    EXPECT_LE(b.model.interrupts - b.interrupts_before, b.own_frames);
    EXPECT_GE(b.foreign_frames, foreign ? 4999 * seconds : 0);
    EXPECT_EQ(b.node.counters().not_mine, 0U);
  }
}

/// The loop does something else for 4 ms, again and again, with interrupts enabled: a late tick is a tick, a
/// second one is a fault with a rest under control, and no frame is lost.
TYPED_TEST(FdcanLoad, ALoopThatIsHeldUpComesToRestUnderControl) {
  LoadedBus<TypeParam> b(scene_of(true), true);
  b.arm();
  for (int n = 0; n < 10; ++n) {  // once in a while
    while (!b.turn()) {
    }
    b.turn(4000);
    b.run(0.05);
  }
  EXPECT_EQ(b.late(), 10U);
  EXPECT_EQ(b.node.supervisor().state(), State::running) << name(b.node.supervisor().fault());
  for (int n = 0; n < 8 && b.node.supervisor().fault() == Fault::none; ++n) b.turn(4000);
  EXPECT_EQ(b.node.supervisor().state(), State::halting);
  b.run(0.01);
  EXPECT_GT(b.torque(), 0.01) << "the weight is carried";
  b.run(3.0);
  EXPECT_EQ(b.node.supervisor().fault(), Fault::tick_late) << "and nothing else";
  EXPECT_EQ(b.bus().overruns(), 0U);
}

/// Interrupts are masked for as long as they may be, while the shortest frames of ours follow one another.
TYPED_TEST(FdcanLoad, MaskedForAsLongAsAllowedNothingIsLost) {
  FdcanModel model{std::is_same_v<TypeParam, hal::fdcan::G4> ? FdcanModel::Chip::g4 : FdcanModel::Chip::h7};
  hal::Fdcan<TypeParam, FdcanModelAccess> bus{FdcanModelAccess{&model}};
  ASSERT_TRUE(bus.open(80'000'000, 1'000'000));
  model.handler = [&] { bus.interrupt(); };
  constexpr std::uint32_t shortest_us = 44 + 3;
  std::uint32_t delivered = 0, received = 0;
  hal::CanFrame f;
  for (std::uint32_t t = 0; t < 2'000'000; ++t) {
    model.mask(t % 200 < bus.masked_us_max);
    if (t % shortest_us == 0) {
      model.deliver({.id = 0x20});
      ++delivered;
    }
    while (t % 500 == 0 && bus.try_receive(f)) ++received;
  }
  model.mask(false);
  while (bus.try_receive(f)) ++received;
  EXPECT_EQ(received, delivered);
  EXPECT_EQ(bus.overruns(), 0U);
  EXPECT_EQ(model.wrong, std::vector<std::string>{});
}

struct OneFrame {
  std::optional<hal::CanFrame> frame;
  static hal::SendStatus try_send(const hal::CanFrame&) { return hal::SendStatus::ok; }
  bool try_receive(hal::CanFrame& f) {
    if (!frame) return false;
    f = *std::exchange(frame, {});
    return true;
  }
};

/// Whatever identifier it has: a frame that the filters reject is one that the cycle would count as not_mine.
template <class D>
void expect_filters_hear_all(const std::string& set, std::uint32_t extended_end, int heard_max = 200) {
  SCOPED_TRACE(set);
  const host::Scene scene =
      host::read_scene_text(std::string(host::starting_scene("five_bar")), "scene of a test",
                            {"command={speed=0.1, acceleration=1.0}", set});
  const auto reference = host::make_reference<float>(scene, host::Pacing::realtime);
  const Cycle<M, D> fresh(std::get<typename Cycle<M, D>::Config>(
      host::make_cycle_config<M>(scene, host::Pacing::realtime, reference)));
  const auto filters = fresh.filters();
  EXPECT_FALSE(filters.list().empty());
  int heard = 0, rejected = 0, judged_count = 0;
  for (std::uint32_t id = 0; id < 0x800 + extended_end; ++id) {
    const bool extended = id >= 0x800;
    bool passes = false, judged = false;
    for (const unsigned size : {0U, 1U, 2U, 4U, 8U}) {
      for (const bool remote : {false, true}) {
        hal::CanFrame f = hal::data_frame(extended ? id - 0x800 : id, static_cast<std::uint8_t>(size));
        f.extended = extended;
        f.remote = remote;
        for (const auto& one : filters.list()) passes = passes || one.matches(f);
        OneFrame bus{f};
        auto cycle = fresh;
        cycle.receive(bus);
        judged = judged || cycle.counters().not_mine == 0;
      }
    }
    if (judged) {
      EXPECT_TRUE(passes) << std::hex << id;
    }
    heard += passes ? 1 : 0;
    rejected += passes ? 0 : 1;
    judged_count += judged ? 1 : 0;
  }
  EXPECT_GT(judged_count, 32) << "two drives and the link";
  EXPECT_LT(heard, heard_max);
  EXPECT_GT(rejected, 1900);
}

TEST(Filters, EveryFrameThatTheCycleJudgesIsHeard) {
  expect_filters_hear_all<drive::OdriveAxis>("drives.protocol=\"odrive\"", 0x100);
  expect_filters_hear_all<drive::OdriveAxis>("drives.protocol=\"odrive_0.5\"", 0x100);
  expect_filters_hear_all<drive::Cia402Axis>("drives.protocol=\"cia402\"", 0x100);
  expect_filters_hear_all<drive::MitAxis>("drives.protocol=\"mit\"", 0x100);
  expect_filters_hear_all<drive::MitAxis>(
      "drives={protocol=\"mit\", dialect=\"cubemars_v3\", velocity_unit=0.01}", 0x6000);
  // Frames of each of 256 sources to a drive are commands to it.
  expect_filters_hear_all<drive::MoteusAxis>("drives.protocol=\"moteus\"", 0x10100, 1200);
}

}  // namespace
}  // namespace esmc::test
