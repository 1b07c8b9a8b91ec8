#include "host_sim/bus/response.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "firmware/drive/canopen.hpp"
#include "firmware/drive/mit.hpp"
#include "firmware/drive/moteus.hpp"
#include "firmware/drive/odrive.hpp"
#include "host_sim/bus/wire.hpp"

namespace esmc::host {
namespace {

using Role = BusMessage::Role;
constexpr int iterations_max = 100'000;

/// Smallest solution of w = f(w) above `from`, f growing; empty when there is none below `limit`.
template <class F>
std::optional<double> fixed_point(double from, double limit, const F& f) {
  double w = from;
  for (int n = 0; n < iterations_max; ++n) {
    const double next = f(w);
    if (next == w) return w;
    if (!(next <= limit)) return std::nullopt;
    w = next;
  }
  return std::nullopt;
}

/// Rounding must not turn a whole number of periods into one more.
double arrivals(double window, double period) { return std::ceil(window / period - 1e-9); }

/// `fast`: of CAN FD, time of a bit of its data; 0: a classic frame.
BusMessage message(std::string name, std::uint32_t id, std::uint32_t size, double period, Role role,
                   bool extended = false, double fast = 0.0) {
  hal::CanFrame f;
  f.id = id;
  f.extended = extended;
  const bool fd = fast > 0.0;
  const std::uint32_t least = fd ? fd_bits(size, extended, fast, false) - interframe_bits
                                 : (extended ? 54 : 34) + 8 * size + trailer_bits;
  const std::uint32_t most = fd ? fd_bits(size, extended, fast, true) : worst_bits(size, extended);
  return {std::move(name), id, extended, arbitration(f), most, least, period, 0.0, role};
}

constexpr double beats_per_s = 100.0;  // of every emulated drive

void add_odrive(const Scene& s, double tick, double beat, std::vector<BusMessage>& out) {
  namespace wire = drive::odrive;
  for (std::size_t i = 0; i < s.drives.nodes.size(); ++i) {
    const auto node = static_cast<std::uint8_t>(s.drives.nodes[i]);
    const auto add = [&](const char* what, wire::Message m, double period, Role role) {
      out.push_back(message(fmt::format("{} {}", what, node), wire::identifier(node, m), 8, period, role));
    };
    add("heartbeat", wire::Message::heartbeat, beat, Role::other);
    add("sample", wire::Message::encoder_estimates, tick, Role::sample);
    if (i >= static_cast<std::size_t>(s.motors())) continue;
    add("torque", wire::Message::set_input_torque, tick, Role::command);
    if (s.drives.torque_mismatch > 0.0)
      add("estimated torque", wire::Message::get_torques, beat, Role::other);
  }
}

void add_cia402(const Scene& s, double tick, double beat, std::vector<BusMessage>& out) {
  namespace wire = drive::canopen;
  out.push_back(message("sync", wire::id_sync, 0, tick, Role::command));
  for (std::size_t i = 0; i < s.drives.nodes.size(); ++i) {
    const auto node = static_cast<std::uint32_t>(s.drives.nodes[i]);
    const auto add = [&](const char* what, std::uint32_t id, std::uint32_t size, double period, Role role) {
      out.push_back(message(fmt::format("{} {}", what, node), id + node, size, period, role));
    };
    add("sample", wire::id_tpdo1, 8, tick, Role::sample);  // status, position, torque
    add("speed", wire::id_tpdo2, 5, tick, Role::sample);   // and mode
    if (i < static_cast<std::size_t>(s.motors())) add("torque", wire::id_rpdo1, 4, tick, Role::command);
    add("heartbeat", wire::id_heartbeat, 1, beat, Role::other);
  }
  out.push_back(message("our heartbeat",
                        wire::id_heartbeat + static_cast<std::uint32_t>(s.drives.controller_node), 1,
                        heartbeat_ticks(s) * tick, Role::other));
}

void add_mit(const Scene& s, double tick, std::vector<BusMessage>& out) {
  const bool v3 = s.drives.dialect == drive::mit::Dialect::cubemars_v3;
  for (std::size_t i = 0; i < s.drives.nodes.size(); ++i) {
    const auto node = static_cast<std::uint32_t>(s.drives.nodes[i]);
    const auto master = static_cast<std::uint32_t>(s.drives.master_id[i]);
    out.push_back(message(fmt::format("reply {}", node), v3 ? drive::mit::v3_reply | node : master, 8, tick,
                          Role::sample, v3));
    out.push_back(message(fmt::format("torque {}", node), v3 ? drive::mit::v3_command | node : node, 8, tick,
                          Role::command, v3));
  }
}

void add_moteus(const Scene& s, double tick, std::vector<BusMessage>& out) {
  namespace wire = drive::moteus;
  for (const int n : s.drives.nodes) {
    const auto node = static_cast<std::uint32_t>(n);
    const std::uint32_t reply = node << 8U, torque = wire::reply_wanted | node;
    out.push_back(message(fmt::format("reply {}", node), reply, wire::reply_size, tick, Role::sample,
                          reply > 0x7FF, s.fast_bit()));
    out.push_back(message(fmt::format("torque {}", node), torque, wire::torque_size, tick, Role::command,
                          true, s.fast_bit()));
  }
}

/// A supervisor computer's, where there is one: docs/esmc.dbc. The controller sends one of them in a tick at
/// most, so that those of a set come in ticks of their own.
void add_link(const CommandScene& c, int motors, double tick, double bits_per_s,
              std::vector<BusMessage>& out) {
  constexpr double table_frames = 4.0;  // table, counters, identity and slots, once a second
  const auto add = [&](const char* what, std::uint32_t offset, double ticks) {
    if (ticks > 0.0) {
      out.push_back(
          message(what, static_cast<std::uint32_t>(c.base_id) + offset, 8, ticks * tick, Role::other));
    }
  };
  if (c.source == link::Source::stream) {
    add("stream position", 0x02, 1);
    add("stream velocity", 0x03, 1);
  }
  const std::size_t sent = out.size();
  add("status", 0x10, c.status_ticks);
  add("table", 0x14, std::max(1.0, bits_per_s / tick / table_frames));
  const double ticks = c.telemetry_ticks;
  add("telemetry", 0x16, ticks > 0.0 ? std::max(1.0, ticks / (2 + motors)) : 0.0);
  for (std::size_t i = sent; i < out.size(); ++i) out[i].in_turn = true;
}

/// Bits that a tick brings at most, but for those of a babbling node: of the link one frame.
double bits_of_tick(const std::vector<BusMessage>& all) {
  double own = 0.0, link = 0.0;
  for (const BusMessage& m : all) {
    if (m.in_turn) link = std::max(link, static_cast<double>(m.bits));
    if (!m.in_turn && m.name != "babbling_node") own += m.bits;
  }
  return own + link;
}

/// All frames of a tick, one after the other, with those of a babbling node between them. Empty: they do not
/// fit in a tick.
std::optional<double> whole_tick(const std::vector<BusMessage>& all, double tick) {
  const double own = bits_of_tick(all);
  if (own > tick) return std::nullopt;
  return fixed_point(own, tick, [&](double w) {
    double bits = own;
    for (const BusMessage& m : all) {
      if (m.name == "babbling_node") bits += (arrivals(w, m.period) + 1.0) * m.bits;  // one was on its way
    }
    return bits;
  });
}

/// Commands are requested when the samples have arrived: the variation of that instant is their jitter, which
/// delays the samples in turn. Returns the latest such instant after the tick's beginning; empty: none.
std::optional<double> settle_jitter(std::vector<BusMessage>& all, std::optional<double> whole,
                                    double latest_max) {
  double earliest = 0.0, commands = 0.0;
  for (const BusMessage& m : all) {
    if (m.role == Role::sample) earliest += m.least;
    if (m.role == Role::command) commands += m.bits;
  }
  double latest = 0.0;
  for (int n = 0; n < 100; ++n) {
    double next = 0.0;
    for (const BusMessage& m : all) {
      if (m.role != Role::sample) continue;
      const auto r = response_time(all, m);
      if (!r) return std::nullopt;
      next = std::max(next, *r);
    }
    // In a loop that is done before the next tick begins, no frame of another tick interferes.
    if (whole) next = std::min(next, *whole - commands);
    if (next == latest) return latest;
    if (next > latest_max) return std::nullopt;
    latest = next;
    for (BusMessage& m : all) {
      if (m.role == Role::command) m.jitter = std::max(0.0, latest - earliest);
    }
  }
  return std::nullopt;
}

}  // namespace

std::optional<double> response_time(const std::vector<BusMessage>& all, const BusMessage& of) {
  double blocking = 0.0, longest = 0.0, demand = 0.0;
  for (const BusMessage& m : all) {
    longest = std::max(longest, m.period);
    if (m.key > of.key) {
      blocking = std::max(blocking, static_cast<double>(m.bits));
    } else {
      demand += m.bits / m.period;
    }
  }
  if (demand > 1.0) return std::nullopt;
  const double limit = 20.0 * longest;
  // Bits of what is more urgent (and, with `own`, of the message itself) asked for in a window.
  const auto urgent = [&](double window, bool own) {
    double bits = 0.0;
    for (const BusMessage& m : all) {
      if (&m == &of ? own : m.key <= of.key) bits += arrivals(window + m.jitter, m.period) * m.bits;
    }
    return bits;
  };
  const auto busy = fixed_point(of.bits, limit, [&](double t) { return blocking + urgent(t, true); });
  if (!busy) return std::nullopt;
  const double instances = arrivals(*busy + of.jitter, of.period);
  double worst = 0.0;
  for (double q = 0.0; q < instances; ++q) {
    // A frame asked for within the first bit of ours still wins: one bit time more.
    const auto wait = fixed_point(blocking + q * of.bits, limit,
                                  [&](double w) { return blocking + q * of.bits + urgent(w + 1.0, false); });
    if (!wait) return std::nullopt;
    worst = std::max(worst, of.jitter + *wait - q * of.period + of.bits);
  }
  return worst;
}

std::vector<BusMessage> bus_messages(const Scene& s) {
  std::vector<BusMessage> out;
  const double tick = s.tick() * s.bitrate, beat = std::max(s.bitrate / beats_per_s, tick);
  if (s.drives.protocol == Protocol::cia402) {
    add_cia402(s, tick, beat, out);
  } else if (s.drives.protocol == Protocol::mit) {
    add_mit(s, tick, out);
  } else if (s.drives.protocol == Protocol::moteus) {
    add_moteus(s, tick, out);
  } else {
    add_odrive(s, tick, beat, out);
  }
  if (s.command) add_link(*s.command, s.motors(), tick, s.bitrate, out);
  if (const auto b = find_effect<BabblingNode>(s.effects)) {
    out.push_back(message("babbling_node", b->identifier, static_cast<std::uint32_t>(b->size),
                          s.bitrate / b->rate_hz, Role::other, b->extended));
  }
  std::ranges::stable_sort(out, {}, &BusMessage::key);
  return out;
}

BusAnalysis analyse_bus(const Scene& scene) {
  std::vector<BusMessage> all = bus_messages(scene);
  const double bit = 1.0 / scene.bitrate;
  BusAnalysis out;
  const double frames = bits_of_tick(all);
  double foreign = 0.0;
  for (const BusMessage& m : all) {
    out.load += m.bits / m.period;
    if (m.name == "babbling_node") foreign += m.bits / m.period;
    if (scene.drives.protocol == Protocol::cia402 && (m.role == Role::sample || m.name == "sync"))
      out.answers_s += m.bits * bit;
  }
  const auto whole = whole_tick(all, scene.tick() * scene.bitrate);
  out.rate_max_hz = std::floor(std::max(0.0, 1.0 - foreign) / (frames * bit));
  out.tick_s = whole.value_or(frames) * bit;
  const auto latest = settle_jitter(all, whole, 5.0 * scene.tick() * scene.bitrate);
  double slowest = 0.0;
  bool bounded = latest.has_value();
  for (const BusMessage& m : all) {
    auto r = latest || m.role != Role::command ? response_time(all, m) : std::nullopt;
    if (r) r = *r - m.jitter;
    if (r && whole && m.role != Role::other) r = std::min(*r, *whole);  // as for settle_jitter()
    if (m.role == Role::command) {
      bounded = bounded && r.has_value();
      slowest = std::max(slowest, r.value_or(0.0));
    }
    out.messages.push_back(
        {m.name, m.id, m.extended, m.period * bit, m.bits, r ? std::optional(*r * bit) : std::nullopt});
  }
  if (bounded) out.loop_s = (whole ? std::min(*whole, *latest + slowest) : *latest + slowest) * bit;
  return out;
}

}  // namespace esmc::host
