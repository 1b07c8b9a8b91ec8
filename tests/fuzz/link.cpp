/// The command interface: frames of any kind, sealed or not, between any states of the supervisor, on a bus
/// that takes frames or not. Checksums and layouts are those of tests/support, not of the firmware.

#include <array>
#include <cmath>
#include <optional>

#include "firmware/link/command_link.hpp"
#include "tests/fuzz/bytes.hpp"
#include "tests/support/link_bytes.hpp"

namespace {

using namespace esmc;
using fuzz::require;
using hal::CanFrame;
using link::Outcome;
using test::Desk;

constexpr unsigned base = 0x780;

/// The checksum of tests/support, which is a long division, as a table: it is affine in every byte.
std::uint8_t seal_of(const CanFrame& f, unsigned session) {
  using Table = std::array<std::array<std::uint8_t, 256>, 10>;
  static const Table table = [] {
    Table t{};
    std::vector<std::uint8_t> bytes(10, 0);
    const std::uint8_t none = test::j1850(bytes);
    for (std::size_t i = 0; i < 10; ++i) {
      for (unsigned v = 0; v < 256; ++v) {
        bytes[i] = static_cast<std::uint8_t>(v);
        t[i][v] = static_cast<std::uint8_t>(test::j1850(bytes) ^ (i == 0 ? 0 : none));
      }
      bytes[i] = 0;
    }
    return t;
  }();
  unsigned c = table[0][f.id & 0xFFU] ^ table[1][(f.id >> 8U) & 0xFFU] ^ table[2][session];
  for (std::size_t i = 1; i < 8; ++i) c ^= table[2 + i][f.data[i]];
  return static_cast<std::uint8_t>(c);
}

link::LinkConfig config(unsigned choice) {
  using link::Bounds;
  link::LinkConfig c;
  c.base_id = base;
  c.session = (choice & 1U) != 0 ? 255 : 77;
  c.counter_jump_max = 2;
  c.command_age_ticks_max = 50;
  c.status_ticks = 4;
  c.telemetry_ticks = (choice & 2U) != 0 ? 5 : 0;
  c.table_ticks = (choice & 4U) != 0 ? 7 : 0;
  c.period_ns = 1'000'000;
  c.source = (choice & 8U) != 0 ? link::Source::stream : link::Source::reference;
  c.space = (choice & 16U) != 0 ? link::Space::base_joints : link::Space::effector;
  c.position = {Bounds{-0.3F, 0.3F}, Bounds{0.0F, 0.3F}};
  c.parameters =
      link::Parameters({40, 40, 150, 300, 1e-3F, 2, 2, 50, 1.0F, 10.0F, 3, (choice & 32U) != 0 ? 4.0F : 0.0F},
                       {Bounds{10, 80}, Bounds{10, 80}, Bounds{0, 200}, Bounds{0, 0}});
  return c;
}

class Run {
 public:
  explicit Run(fuzz::Bytes& in)
      : in_(in),
        choice_(in.u8()),
        config_(config(choice_)),
        has_store_((choice_ & 64U) != 0),
        link_(config_),
        supervisor_(supervision(in)) {
    desk_.base = base;
    desk_.session = config_.session;
    if (has_store_) link_.store_status({.state = store_});
    link_.offer_homing(true);
    if (more()) link_.capture_into(memory_);
    begin();
  }
  void go() {
    while (!in_.empty()) step();
    end();
  }

 private:
  [[nodiscard]] bool more() const { return (choice_ & 128U) != 0; }
  [[nodiscard]] Supervisor::Config supervision(fuzz::Bytes& in) const {
    if (!more()) return {.can_halt = true, .after_halt = AfterHalt::hold, .sign_test = false};
    const unsigned how = in.u8();
    return {.can_halt = (how & 1U) != 0,
            .after_halt = static_cast<AfterHalt>(how / 2 % 3),
            .sign_test = how / 6 % 2 != 0};
  }

  void step() {
    in_.one_of(
        10,
        [&] {
          end();
          begin();
        },
        [&] { receive(in_.frame()); }, [&] { receive(in_.frame(base + in_.below(32))); },
        [&] { sealed(in_.frame(base + in_.below(7)), in_.u8()); },
        [&] {
          if (const unsigned what = in_.below(12); what < 11)
            receive(order(what));
          else
            receive(order(Desk::override_speed + (static_cast<unsigned>(in_.u8()) << 8U)));
        },
        [&] { point(); }, [&] { sample(); },
        [&] { write(in_.below(16), in_.yes() ? in_.f32() : static_cast<float>(in_.u8())); },
        [&] { receive(last_); }, [&] { arm(); });
  }

  // ---- what a supervisor computer sends
  // ---------------------------------------------------------------------------

  static CanFrame seal(CanFrame f, unsigned session) {
    f.data[0] = seal_of(f, session);
    return f;
  }
  /// As it came, with the checksum right, and in part with counter, session, tick and table right.
  void sealed(CanFrame f, unsigned how) {
    const unsigned message = f.id - base;
    if ((how & 1U) != 0 && message < 6) {
      desk_.counter[message] = (desk_.counter[message] + 1) & 15;
      f.data[1] = static_cast<std::uint8_t>((f.data[1] & 0xF0U) | desk_.counter[message]);
    }
    if ((how & 2U) != 0) {
      f.data[4] = static_cast<std::uint8_t>(desk_.tick);
      f.data[5] = static_cast<std::uint8_t>(desk_.tick >> 8U);
    }
    receive(seal(f, (how & 4U) != 0 ? 0U : (how & 8U) != 0 ? in_.u8() : desk_.session));
  }
  /// The 48 bits behind the header, in this session and with the next counter.
  CanFrame made(unsigned message, std::uint64_t payload, unsigned tag = 0) {
    CanFrame f;
    f.id = base + message;
    f.size = 8;
    desk_.counter[message] = (desk_.counter[message] + 1) & 15;
    f.data[1] = static_cast<std::uint8_t>(desk_.counter[message] | (tag << 4U));
    for (unsigned i = 0; i < 6; ++i) f.data[2 + i] = static_cast<std::uint8_t>(payload >> (8U * i));
    return seal(f, desk_.session);
  }
  CanFrame order(unsigned what) {
    return made(Desk::command, what | (std::uint64_t{desk_.tick & 0xFFFF} << 16) |
                                   (std::uint64_t{desk_.crc32 & 0xFFFF} << 32));
  }
  CanFrame pair(unsigned message, int a, int b, bool elsewhere = false) {
    const auto u24 = [](int v) { return static_cast<std::uint64_t>(static_cast<unsigned>(v) & 0xFFFFFFU); };
    return made(message, u24(a) | (u24(b) << 24),
                static_cast<unsigned>(config_.space) ^ (elsewhere ? 1U : 0U));
  }
  void point() {
    const auto x = static_cast<std::int16_t>(in_.u16()), y = static_cast<std::int16_t>(in_.u16());
    receive(pair(Desk::point, x * 16, y * 16));
  }
  void sample() {
    const auto x = static_cast<std::int16_t>(in_.u16()), v = static_cast<std::int16_t>(in_.u16());
    receive(pair(Desk::position, x * 8, 150000 + x * 4));
    const unsigned how = in_.below(8);
    if (how == 7) return;
    receive(pair(Desk::velocity, v * 4, -v, how == 6));
  }
  void write(unsigned index, float value) {
    receive(made(Desk::write, index | (std::uint64_t{std::bit_cast<std::uint32_t>(value)} << 16U)));
  }
  /// From wherever it is to running, as a program would do it.
  void arm() {
    for (const unsigned what : {Desk::reset, Desk::stream, Desk::arm, Desk::none}) {
      receive(made(Desk::request, 2));
      end();
      begin();
      receive(order(what));
      end();
      begin();
    }
  }

  // ---- the link
  // ---------------------------------------------------------------------------------------------------

  void receive(const CanFrame& f) {
    last_ = f;
    const auto before = link_.counters();
    const auto parameters = values();
    const Outcome o = link_.receive(f);
    const auto& after = link_.counters();
    const bool in_block = !f.extended && f.id >= base && f.id < base + 32;
    require((o == Outcome::not_mine) == (!in_block || (f.remote && f.id >= base + 16)),
            "what is in our block is ours");
    if (!in_block) return;
    if (f.id >= base + 16) {
      require(f.remote || o == Outcome::foreign_command, "only we send these");
      return;
    }
    const unsigned counted = after.obeyed + after.bad_crc + after.bad_counter + after.refused -
                             before.obeyed - before.bad_crc - before.bad_counter - before.refused;
    require(counted == 1, "every frame is counted once");
    const bool plain = f.size == 8 && !f.remote && !f.fd && f.id < base + 6;
    require(plain || o == Outcome::malformed, "classic data frames of eight bytes");
    if (!plain) return;
    const bool ours = f.data[0] == seal_of(f, session_), anybody = f.data[0] == seal_of(f, 0);
    const bool takes_away = f.id == base && f.data[1] < 16 &&
                            (f.data[2] == Desk::disarm || f.data[2] == Desk::off) && f.data[3] == 0;
    if (!ours && !(anybody && f.id == base))
      require(o == Outcome::bad_crc, "the checksum is that of this session");
    if (!ours && o == Outcome::obeyed)
      require(anybody && takes_away, "without the session: only what takes torque away");
    if ((ours || anybody) && takes_away)
      require(o == Outcome::obeyed, "what takes torque away is always obeyed");
    const unsigned which = f.id - base, count = f.data[1] & 15U;
    if (ours) {
      const unsigned ahead = (count - heard_[which]) & 15U;
      const bool in_order = !known_[which] || ahead == 1 || ahead == 2;
      if (!in_order && !takes_away) require(o != Outcome::obeyed, "nothing is obeyed twice");
      if (in_order && o != Outcome::malformed) known_[which] = true, heard_[which] = count;
    }
    if (o == Outcome::obeyed) obeyed(f);
    const bool forgets = f.id == base + Desk::command && f.data[2] == Desk::forget;
    if (o != Outcome::obeyed || (f.id != base + Desk::write && !forgets))
      require(values() == parameters, "parameters are written by an obeyed write");
  }
  void obeyed(const CanFrame& f) {
    if (f.id == base + Desk::command) {
      if (f.data[2] == Desk::off) stopped_ = true;
      if (f.data[2] == Desk::override_speed || f.data[2] == Desk::resume)
        require(f.data[3] <= 100 && (supervisor_.state() == State::running ||
                                     (supervisor_.state() == State::disabled && f.data[3] > 0)),
                "a percentage, for a reference that leads or will");
      const bool arms = f.data[2] == Desk::arm || f.data[2] == Desk::home;
      if (arms) require(supervisor_.state() == State::disabled, "armed while disabled only");
      if (arms || f.data[2] == Desk::store)
        require(test::Desk::word(f, 6, 2) == (link_.parameters().crc() & 0xFFFFU),
                "armed and stored with a known table");
      const bool keeps = f.data[2] == Desk::store || f.data[2] == Desk::forget;
      if (keeps)
        require(has_store_ && supervisor_.state() == State::disabled,
                "stored while disabled only, where there is a store");
      if (keeps || arms) require(storing_ == 0, "one thing at a time");
      if (f.data[2] == Desk::forget)
        require(link_.parameters().values() == config_.parameters.values(), "baked values");
      if (keeps) storing_ = 3;
    }
    if (f.id == base + Desk::write) {
      require(supervisor_.state() == State::disabled && f.data[2] < 3, "gains are written while disabled");
      require(storing_ == 0, "what is being stored is not changed");
      const float v = test::Desk::real(f, 4);
      require(v >= (f.data[2] < 2 ? 10.0F : 0.0F) && v <= (f.data[2] < 2 ? 80.0F : 200.0F),
              "gains stay within their bounds");
      require(link_.parameters().at(f.data[2]) == v, "an obeyed write is written");
    }
  }
  /// Bit patterns of all parameters.
  [[nodiscard]] std::array<std::uint32_t, link::parameter_count> values() const {
    std::array<std::uint32_t, link::parameter_count> v{};
    for (std::uint8_t i = 0; i < link::parameter_count; ++i)
      v[i] = std::bit_cast<std::uint32_t>(link_.parameters().at(i));
    return v;
  }

  void begin() {
    link_.begin_tick();
    stopped_ = false;
    session_ = link_.session();
  }
  void end() {
    const link::Request r = link_.take();
    if (stopped_) require(r.command == Command::stop, "off is not softened");
    for (unsigned i = 0; i < 2; ++i) {
      if (!r.has_point && !r.has_sample) break;
      require(r.position[i] >= config_.position[i].lower && r.position[i] <= config_.position[i].upper,
              "positions within bounds");
      if (r.has_sample) require(std::fabs(r.velocity[i]) <= 1.0F, "speeds within bounds");
    }
    require(int{r.has_point} + int{r.has_sample} + int{r.hold} <= 1, "one motion at a time");
    if (r.has_point || r.has_sample || r.hold)
      require(supervisor_.state() == State::running, "guided while running only");
    const link::StoreRequest wish = link_.take_store_request();
    require(wish == link::StoreRequest::none || storing_ == 3, "nothing is stored that was not requested");
    if (storing_ > 0 && --storing_ == 0)
      store_ = (choice_ & 1U) != 0 ? link::StoreState::stored : link::StoreState::failed;
    if (has_store_ && storing_ == 0) link_.store_status({.state = store_});
    const unsigned drives = in_.u8();
    supervisor_.begin_tick(r.command, {(drives & 1U) == 0, (drives & 2U) == 0}, (drives & 4U) != 0);
    if ((drives & 0xF0U) == 0xF0U) supervisor_.raise(static_cast<Fault>(in_.below(fault_count)));
    if (link_.lost()) {
      require(supervisor_.state() != State::disabled, "missed only where it had armed");
      supervisor_.raise(Fault::command_lost);
    }
    link::Report report;
    report.joints = static_cast<std::uint8_t>(drives % 5);
    const unsigned room = (drives & 8U) == 0 ? 99
                          : more()           ? in_.below(8)
                                             : 0;  // so many frames the bus takes
    unsigned frames = 0;
    link_.transmit(supervisor_, report, [&](const CanFrame& f) {
      told(f);
      const bool takes = frames++ < room;
      if (takes) desk_.hear(f);
      return takes;
    });
    require(frames <= 9, "a few frames per tick");
    if (desk_.heard.size() > 16) desk_.heard.clear();
  }
  void told(const CanFrame& f) const {
    require(hal::well_formed(f) && !f.extended && !f.remote && !f.fd && f.size == 8,
            "classic frames of eight bytes");
    require(f.id >= base + 0x10 && f.id <= base + 0x1E, "telemetry");
    if (f.id != base + Desk::status) return;
    require(f.data[7] != 0 && f.data[0] == seal_of(f, f.data[7]), "Status has a session and a checksum");
    require(f.data[1] / 16 == static_cast<unsigned>(supervisor_.state()) &&
                f.data[2] == static_cast<unsigned>(supervisor_.fault()),
            "Status says what is");
    const unsigned reaction = supervisor_.fault() == Fault::none    ? 0
                              : supervisor_.state() == State::fault ? 1
                                                                    : 2;
    require((f.data[3] & 3U) == reaction, "Status says what was done");
  }

  std::array<link::CaptureRecord, 12> memory_{};
  fuzz::Bytes& in_;
  unsigned choice_;
  link::LinkConfig config_;
  bool has_store_;
  unsigned storing_ = 0;  // ticks that it will take
  link::StoreState store_ = link::StoreState::idle;
  link::CommandLink link_;
  Supervisor supervisor_;
  Desk desk_;
  CanFrame last_;
  std::uint8_t session_ = 0;
  bool stopped_ = false;
  std::array<bool, 6> known_{};
  std::array<unsigned, 6> heard_{};
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Bytes in(data, size);
  Run(in).go();
  return 0;
}
