#include "host_sim/drives/cia402_axis.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "firmware/drive/canopen.hpp"

namespace esmc::host {

namespace wire = drive::canopen;

namespace {

constexpr std::uint8_t pre_operational = 0x7F, operational = 0x05, stopped = 0x04;
constexpr std::uint16_t emergency_heartbeat = 0x8130, emergency_pdo_length = 0x8210,
                        emergency_rpdo_deadline = 0x8250;
constexpr std::uint8_t register_generic = 0x01, register_communication = 0x10;
constexpr int mode_torque = 10;
constexpr std::uint32_t cob_id_bits = 0x7FF;
constexpr std::uint32_t cob_extended = 0x2000'0000;  // 29 bits, which this drive does not have
constexpr std::uint8_t entries_max = 8;              // of a mapping

constexpr std::array<std::uint32_t, 4> rpdo_id{0x200, 0x300, 0x400, 0x500},
    tpdo_id{0x180, 0x280, 0x380, 0x480};

std::uint16_t object16(unsigned first, unsigned number) { return static_cast<std::uint16_t>(first + number); }

std::uint32_t mask_of(std::uint8_t bytes) { return bytes == 4 ? 0xFFFF'FFFFU : (1U << (8U * bytes)) - 1U; }

std::int32_t saturated(double v) {
  return static_cast<std::int32_t>(std::clamp(std::round(v), -2147483648.0, 2147483647.0));
}

/// Whether an object may be mapped to a PDO towards the drive, or from it.
bool mappable(std::uint16_t index, bool towards) {
  constexpr std::array in{0x6040, 0x6060, 0x6071, 0x6072};
  constexpr std::array out{0x1001, 0x603F, 0x6041, 0x6061, 0x6064, 0x606C, 0x6077};
  return towards ? std::ranges::count(in, index) > 0 : std::ranges::count(out, index) > 0;
}

struct Mapped {
  std::uint16_t index;
  std::uint8_t sub, bytes;
};
Mapped mapped(std::uint32_t entry) {
  return {static_cast<std::uint16_t>(entry >> 16U), static_cast<std::uint8_t>(entry >> 8U),
          static_cast<std::uint8_t>((entry & 0xFFU) / 8U)};
}

bool in_range(std::uint16_t index, unsigned first) { return index >= first && index < first + 4U; }

}  // namespace

Cia402Axis::Cia402Axis(const AxisMount& mount, const Settings& settings, const SensorEffects& sensor,
                       int joint, std::uint64_t seed)
    : EmulatedAxis(mount, sensor, settings.period, joint, seed), settings_(settings) {
  define_communication();
  define_drive();
}

/// Gives the dictionary the form that the drive's list of objects or its defects have.
void Cia402Axis::restrict_dictionary() {
  const Defects& d = settings_.defects;
  std::erase_if(objects_, [&](const auto& o) {
    const std::uint32_t index = o.first >> 8U;
    return (d.no_6072 && index == 0x6072) || (d.no_1029 && index == 0x1029) ||
           (d.no_rpdo_deadline && index >= 0x1400 && index < 0x1400 + pdos && (o.first & 0xFFU) == 5);
  });
  if (settings_.objects.empty()) return;
  std::map<std::uint32_t, Entry> listed;
  for (const ListedObject& o : settings_.objects) {
    const auto at = objects_.find(key(o.index, o.sub));
    const std::uint32_t before = at == objects_.end() ? 0 : at->second.value;
    listed[key(o.index, o.sub)] = {o.value.value_or(before) & mask_of(o.bytes), o.bytes, o.writable};
  }
  objects_ = std::move(listed);
}

// ---- object dictionary ----

void Cia402Axis::define(std::uint16_t index, std::uint8_t sub, std::uint8_t bytes, std::uint32_t value,
                        bool writable) {
  objects_[key(index, sub)] = {value & mask_of(bytes), bytes, writable};
}
std::uint32_t Cia402Axis::value(std::uint16_t index, std::uint8_t sub) const {
  const auto at = objects_.find(key(index, sub));
  return at == objects_.end() ? 0 : at->second.value;
}
void Cia402Axis::set(std::uint16_t index, std::uint8_t sub, std::uint32_t value) {
  const auto at = objects_.find(key(index, sub));
  if (at != objects_.end()) at->second.value = value & mask_of(at->second.bytes);
}

/// Factory settings: heartbeats off, every PDO sent when it changes.
void Cia402Axis::define_communication() {
  const std::uint32_t n = node();
  define(0x1000, 0, 4, 0x0002'0192, false);  // a servo drive of profile 402
  define(0x1001, 0, 1, 0, false);
  define(0x1005, 0, 4, 0x80, true);
  define(0x1006, 0, 4, 0, true);
  define(0x1014, 0, 4, 0x80 + n, true);
  define(0x1016, 0, 1, 1, false);
  define(0x1016, 1, 4, 0, true);
  define(0x1017, 0, 2, 0, true);
  define(0x1018, 0, 1, 4, false);
  for (std::uint8_t sub = 1; sub <= 4; ++sub) define(0x1018, sub, 4, sub == 4 ? n : 0, false);
  define(0x1029, 0, 1, 1, false);
  define(0x1029, 1, 1, 0, true);
  for (unsigned i = 0; i < pdos; ++i) {
    const auto side = [&](unsigned communication, unsigned mapping, std::uint32_t id) {
      define(object16(communication, i), 0, 1, 5, false);
      define(object16(communication, i), 1, 4, id + n, true);
      define(object16(communication, i), 2, 1, 255, true);
      define(object16(communication, i), 5, 2, 0, true);
      define(object16(mapping, i), 0, 1, 1, true);
      for (std::uint8_t sub = 1; sub <= entries_max; ++sub) define(object16(mapping, i), sub, 4, 0, true);
      set(object16(mapping, i), 1, mapping == 0x1600 ? 0x6040'0010 : 0x6041'0010);
    };
    side(0x1400, 0x1600, rpdo_id[i]);
    side(0x1800, 0x1A00, wire::cob_no_rtr | tpdo_id[i]);
  }
  restrict_dictionary();
}

void Cia402Axis::define_drive() {
  define(0x6007, 0, 2, 3, true);
  define(0x603F, 0, 2, 0, false);
  define(0x6040, 0, 2, 0, true);
  define(0x6041, 0, 2, 0, false);
  define(0x605A, 0, 2, 6, true);
  define(0x605E, 0, 2, 2, true);
  define(0x6060, 0, 1, 0, true);
  define(0x6061, 0, 1, 0, false);
  define(0x6064, 0, 4, 0, false);
  define(0x606C, 0, 4, 0, false);
  define(0x6071, 0, 2, 0, true);
  define(0x6072, 0, 2, static_cast<std::uint32_t>(std::clamp(1000.0 * settings_.max_torque, 0.0, 65535.0)),
         true);
  define(0x6076, 0, 4,
         static_cast<std::uint32_t>(std::llround(settings_.rated_torque / settings_.rated_torque_unit)),
         false);
  define(0x6077, 0, 2, 0, false);
  define(0x60B2, 0, 2, settings_.defects.torque_offset_left ? 100 : 0, true);
  define(0x60C2, 0, 1, 2, false);
  define(0x60C2, 1, 1, 1, true);
  define(0x60C2, 2, 1, 0xFD, true);     // -3: milliseconds
  define(0x6502, 0, 4, 0x0225, false);  // profile position and velocity, homing, cyclic torque
  restrict_dictionary();
}

void Cia402Axis::serve(const hal::CanFrame& request, const Send& send) {
  const auto r = wire::decode_sdo_request(request);
  if (!r || r->kind == wire::SdoKind::abort) return;
  const auto abort = [&](std::uint32_t code) { send(wire::encode_sdo_abort(node(), r->object, code)); };
  if (r->kind == wire::SdoKind::other) return abort(wire::abort_command);
  const auto at = objects_.find(key(r->object.index, r->object.sub));
  if (at == objects_.end()) {
    const bool known = objects_.contains(key(r->object.index, 0));
    return abort(known ? wire::abort_no_sub_index : wire::abort_no_object);
  }
  const Entry entry = at->second;
  if (r->kind == wire::SdoKind::read) {
    refresh();
    send(wire::encode_sdo_value(node(), r->object, at->second.value, entry.bytes));
    return;
  }
  if (!entry.writable) return abort(wire::abort_read_only);
  if (r->size != 0 && r->size != entry.bytes) return abort(wire::abort_length);
  const std::uint32_t value = r->value & mask_of(entry.bytes);
  if (const std::uint32_t reason = objection(r->object.index, r->object.sub, value)) return abort(reason);
  write(r->object.index, r->object.sub, value, send);
  send(wire::encode_sdo_written(node(), r->object));
}

std::uint32_t Cia402Axis::objection(std::uint16_t index, std::uint8_t sub, std::uint32_t value) const {
  const auto refused_unless = [](bool allowed) { return allowed ? 0U : wire::abort_value; };
  const auto option = [&](int high) {
    const int v = static_cast<std::int16_t>(value);
    return refused_unless(0 <= v && v <= high);
  };
  switch (index) {
    case 0x1005:
      return refused_unless(value == 0x80);  // another identifier may be one of its own
    case 0x1014:
      return refused_unless((value & ~wire::cob_invalid) == 0x80U + node());
    case 0x1029:
      return refused_unless(value <= 2);
    case 0x6007:
      return option(3);
    case 0x605A:
      return option(8);
    case 0x605E:
      return option(4);
    case 0x6060:
      return refused_unless(value == 0 ||
                            (value <= 32 && (this->value(0x6502, 0) >> (value - 1U) & 1U) != 0));
    default:
      return objection_to_pdo(index, sub, value);
  }
}

/// Refuses a change of a mapping in use, and objects that do not exist or do not fit.
std::uint32_t Cia402Axis::objection_to_pdo(std::uint16_t index, std::uint8_t sub, std::uint32_t value) const {
  const bool in = in_range(index, 0x1400) || in_range(index, 0x1600);
  const bool communication = in_range(index, 0x1400) || in_range(index, 0x1800);
  const bool mapping = in_range(index, 0x1600) || in_range(index, 0x1A00);
  if (!communication && !mapping) return 0;
  if (nmt_ == operational || power_ == Power::enabled) return wire::abort_device_state;
  const unsigned number = index & 3U;
  const std::uint32_t cob = this->value(object16(in ? 0x1400 : 0x1800, number), 1);
  const bool valid = (cob & wire::cob_invalid) == 0;
  if (communication && sub == 1) {
    const std::uint32_t id = value & 0x1FFF'FFFFU;
    const bool moved = valid && (value & wire::cob_invalid) == 0 && id != (cob & 0x1FFF'FFFFU);
    const bool long_id = (value & cob_extended) != 0;
    const bool remote = settings_.defects.rtr_bit_required && !in && (value & wire::cob_no_rtr) == 0;
    return moved || long_id || remote || id < 0x181 || id > 0x57F ? wire::abort_value : 0;
  }
  if (valid) return wire::abort_device_state;
  if (communication) return sub == 2 && value > 240 && value < 254 ? wire::abort_value : 0;
  const std::uint16_t map = object16(in ? 0x1600 : 0x1A00, number);
  if (sub > 0) {
    if (this->value(map, 0) != 0) return wire::abort_device_state;
    const Mapped m = mapped(value);
    const auto at = objects_.find(key(m.index, m.sub));
    const bool fits = at != objects_.end() && at->second.bytes * 8U == (value & 0xFFU);
    return fits && mappable(m.index, in) ? 0 : wire::abort_not_mappable;
  }
  if (value > entries_max) return wire::abort_pdo_length;
  unsigned bytes = 0;
  for (std::uint8_t i = 1; i <= static_cast<std::uint8_t>(value); ++i) {
    const Mapped m = mapped(this->value(map, i));
    if (!objects_.contains(key(m.index, m.sub)))
      return wire::abort_not_mappable;  // an entry that was never written
    bytes += m.bytes;
  }
  return bytes > 8 ? wire::abort_pdo_length : 0;
}

void Cia402Axis::write(std::uint16_t index, std::uint8_t sub, std::uint32_t value, const Send& send) {
  set(index, sub, value);
  if (index == 0x6040) control(static_cast<std::uint16_t>(value), send);
  if (index == 0x1016) watching_ = lost_ = false;  // watched from its next heartbeat on
  if (index == 0x1017) since_heartbeat_ = 0.0;
}

// ---- the bus ----

void Cia402Axis::publish(double joint_angle, double joint_rate, const Send& send) {
  reading_ = sensor_.read(truth(joint_angle, joint_rate));
  if (power_ == Power::fault_reaction) go(Power::fault);
  watch_master(send);
  watch_commands(send);
  told_ = false;
  since_heartbeat_ += settings_.period;
  const double beat = 1e-3 * value(0x1017, 0);
  // Half a period of slack: sums of periods are not exact.
  const bool beats = beat > 0.0 && since_heartbeat_ > beat - 0.5 * settings_.period;
  const bool reports = settings_.lockstep && nmt_ != operational;
  if (!booted_ || beats || reports) report_state(send);
  for (unsigned i = 0; i < pdos; ++i) {
    if (std::exchange(due_[i], false) && nmt_ == operational) send_pdo(i, send);
  }
}

void Cia402Axis::report_state(const Send& send) {
  send(wire::encode_heartbeat(node(), static_cast<wire::NmtState>(booted_ ? nmt_ : 0)));
  booted_ = true;
  since_heartbeat_ = 0.0;
}

bool Cia402Axis::receive(const hal::CanFrame& f, const Send& send) {
  if (f.extended || f.fd || f.remote) return false;
  if (f.id == 0x000) {
    manage(f, send);
    return false;
  }
  const auto sync = objects_.find(key(0x1005, 0));
  if (f.id == (sync != objects_.end() ? sync->second.value & cob_id_bits : wire::id_sync)) {
    if (nmt_ != operational) return false;
    synchronise(send);
    return told_;
  }
  const std::uint32_t master = value(0x1016, 1) >> 16U;
  if (master != 0 && f.id == 0x700 + master) {
    watching_ = true;
    since_master_ = 0.0;
    if (lost_ && !faulty()) emergency(0, send);
    lost_ = false;
    return false;
  }
  if (f.id == 0x600U + node() && nmt_ != stopped) serve(f, send);
  for (unsigned i = 0; i < pdos; ++i) {
    const std::uint32_t cob = value(object16(0x1400, i), 1);
    if ((cob & wire::cob_invalid) == 0 && f.id == (cob & cob_id_bits) && nmt_ == operational)
      receive_pdo(i, f, send);
  }
  if (f.id != 0x200U + node()) return false;
  told_ = true;
  return nmt_ != operational;
}

bool Cia402Axis::commanded_by(const hal::CanFrame& f) const {
  if (f.extended || f.fd || f.remote) return false;
  if (const auto nmt = wire::decode_nmt(f); nmt && f.id == 0x000)
    return nmt->node == 0 || nmt->node == node();
  if (f.id == 0x600U + node()) return true;
  for (unsigned i = 0; i < pdos; ++i) {
    const std::uint32_t cob = value(object16(0x1400, i), 1);
    const bool moved = (cob & wire::cob_invalid) == 0 && f.id == (cob & cob_id_bits);
    if (moved || f.id == rpdo_id[i] + node()) return true;
  }
  return false;
}

void Cia402Axis::manage(const hal::CanFrame& f, const Send& send) {
  const auto nmt = wire::decode_nmt(f);
  if (!nmt || (nmt->node != 0 && nmt->node != node())) return;
  switch (nmt->command) {
    case wire::NmtCommand::start:
      nmt_ = operational;
      due_ = {};
      expected_ = {};
      return;
    case wire::NmtCommand::stop:
      return leave_operational(stopped, send);
    case wire::NmtCommand::enter_pre_operational:
      return leave_operational(pre_operational, send);
    case wire::NmtCommand::reset_node:
    case wire::NmtCommand::reset_communication:
      go(Power::disabled);
      define_communication();
      if (nmt->command == wire::NmtCommand::reset_node) {
        define_drive();
        last_control_ = 0;
      }
      set(0x603F, 0, 0);  // with its fault
      nmt_ = pre_operational;
      booted_ = watching_ = lost_ = false;
      if (!settings_.lockstep) report_state(send);
      return;
  }
}

void Cia402Axis::leave_operational(std::uint8_t to, const Send& send) {
  confirmations_ = 0;
  const bool keeps = settings_.defects.pre_operational_keeps_torque;
  const bool ends = keeps ? to == stopped && nmt_ != stopped : nmt_ == operational;
  if (ends && power_ == Power::enabled) connection_lost(emergency_heartbeat, send);
  nmt_ = to;
}

void Cia402Axis::watch_master(const Send& send) {
  since_master_ += settings_.period;
  const double patience = 1e-3 * (value(0x1016, 1) & 0xFFFFU);
  if (settings_.defects.watchdog_off || !watching_ || patience <= 0.0 ||
      since_master_ < patience + 0.5 * settings_.period)
    return;
  watching_ = false;
  lost_ = true;
  connection_lost(emergency_heartbeat, send);
  // Error behaviour: 0 from operational to pre-operational, 1 as it is, 2 stopped.
  const std::uint32_t behaviour = value(0x1029, 1);
  if (behaviour == 1 || (behaviour == 0 && nmt_ != operational)) return;
  confirmations_ = 0;
  nmt_ = behaviour == 0 ? pre_operational : stopped;
}

/// Deadline of each RPDO, from its first one in operational on.
void Cia402Axis::watch_commands(const Send& send) {
  constexpr double resolution = 1e-3;
  for (unsigned i = 0; i < pdos; ++i) {
    since_rpdo_[i] += settings_.period;
    const double late = since_rpdo_[i] - 0.5 * settings_.period;
    if (!expected_[i] || nmt_ != operational || late < resolution) continue;
    const double patience = resolution * value(object16(0x1400, i), 5);
    if (patience <= 0.0 || late < patience) continue;
    expected_[i] = false;
    connection_lost(emergency_rpdo_deadline, send);
  }
}

/// Reaction by the abort-connection option.
void Cia402Axis::connection_lost(std::uint16_t code, const Send& send) {
  switch (value(0x6007, 0)) {
    case 1:
      return fail(code, send);
    case 2:
      if (!faulty()) go(Power::disabled);
      break;
    case 3:
      quick_stop();
      break;
    default:
      break;
  }
  emergency(code, send);
}

void Cia402Axis::emergency(std::uint16_t code, const Send& send) {
  set(0x1001, 0, (code != 0 ? register_communication : 0U) | (faulty() ? register_generic : 0U));
  if (nmt_ == stopped || (value(0x1014, 0) & wire::cob_invalid) != 0) return;
  send(wire::encode_emergency(node(), {code, static_cast<std::uint8_t>(value(0x1001, 0))}));
}

void Cia402Axis::synchronise(const Send& send) {
  for (unsigned i = 0; i < pdos; ++i) {
    const std::uint32_t every = value(object16(0x1800, i), 2);
    if (every < 1 || every > 240 || ++syncs_[i] < every) continue;
    syncs_[i] = 0;
    due_[i] = settings_.lockstep;
    if (!settings_.lockstep) send_pdo(i, send);
  }
}

void Cia402Axis::send_pdo(unsigned number, const Send& send) {
  const std::uint32_t cob = value(object16(0x1800, number), 1);
  const std::uint32_t count = value(object16(0x1A00, number), 0);
  if ((cob & wire::cob_invalid) != 0 || count == 0) return;
  refresh();
  hal::CanFrame f = hal::data_frame(cob & cob_id_bits, 0);
  for (std::uint8_t i = 1; i <= count; ++i) {
    const Mapped m = mapped(value(object16(0x1A00, number), i));
    hal::put_field(f, f.size, value(m.index, m.sub), m.bytes);
    f.size = static_cast<std::uint8_t>(f.size + m.bytes);
    if (m.index == 0x6041) confirmations_ = closed_loop() ? confirmations_ + 1 : 0;
  }
  send(f);
}

void Cia402Axis::receive_pdo(unsigned number, const hal::CanFrame& received, const Send& send) {
  const hal::CanFrame f = settings_.defects.short_frames_stale ? stale_[number].fill(received) : received;
  const std::uint16_t map = object16(0x1600, number);
  const std::uint32_t count = value(map, 0);
  std::size_t bytes = 0;
  for (std::uint8_t i = 1; i <= count; ++i) bytes += mapped(value(map, i)).bytes;
  if (f.size < bytes) return emergency(emergency_pdo_length, send);
  expected_[number] = true;
  since_rpdo_[number] = 0.0;
  std::size_t at = 0;
  // Objects first, controlword last: the torque of the frame that enables is the first to act.
  std::uint32_t control_word = 0;
  bool controls = false;
  for (std::uint8_t i = 1; i <= count; ++i) {
    const Mapped m = mapped(value(map, i));
    const std::uint32_t v = hal::get_field(f, at, m.bytes);
    at += m.bytes;
    if (m.index == 0x6040) {
      controls = true;
      control_word = v;
    } else if (objection(m.index, m.sub, v) == 0) {
      set(m.index, m.sub, v);
    }
  }
  if (controls) write(0x6040, 0, control_word, send);
}

// ---- the drive ----

void Cia402Axis::go(Power to) {
  if (power_ == Power::enabled && to != Power::enabled) {
    set(0x6071, 0, 0);
    confirmations_ = 0;
  }
  power_ = to;
}

void Cia402Axis::quick_stop() {
  if (power_ == Power::enabled && value(0x605A, 0) > 4) return go(Power::quick_stop);  // 5..8: stay in it
  if (power_ == Power::enabled || power_ == Power::ready || power_ == Power::on) go(Power::disabled);
}

void Cia402Axis::fail(std::uint16_t code, const Send& send) {
  if (power_ == Power::fault || power_ == Power::fault_reaction) return;
  go(Power::fault_reaction);
  set(0x603F, 0, code);
  emergency(code, send);
}

/// Transitions of the profile, one per controlword.
void Cia402Axis::control(std::uint16_t word, const Send& send) {
  const bool edge = (word & 0x80U) != 0 && (last_control_ & 0x80U) == 0;
  last_control_ = word;
  if (power_ == Power::fault) {
    if (!edge || lost_) return;
    go(Power::disabled);
    set(0x603F, 0, 0);
    emergency(0, send);
    return;
  }
  if (power_ == Power::fault_reaction || power_ == Power::not_ready || (word & 0x80U) != 0) return;
  if ((word & 0x02U) == 0) {  // disable voltage
    go(Power::disabled);
  } else if ((word & 0x04U) == 0) {
    quick_stop();
  } else if (power_ == Power::quick_stop) {
    if ((word & 0x0FU) == 0x0F) go(Power::enabled);
  } else if ((word & 0x01U) == 0) {  // shutdown
    go(Power::ready);
  } else if (power_ == Power::ready) {  // switch on; with 0F as well: one step at a time
    go(Power::on);
  } else if (power_ == Power::on || power_ == Power::enabled) {
    go((word & 0x08U) != 0 ? Power::enabled : Power::on);
  }
}

std::uint16_t Cia402Axis::statusword() const {
  constexpr std::uint16_t voltage_and_remote = 0x0210, follows = 0x1000;
  // In the order of Power.
  constexpr std::array<std::uint16_t, 8> states{0x0000, 0x0040, 0x0021, 0x0023,
                                                0x0027, 0x0007, 0x000F, 0x0008};
  if (power_ == Power::not_ready) return 0;
  const std::uint16_t word = states[static_cast<std::size_t>(power_)] | voltage_and_remote;
  return closed_loop() ? word | follows : word;
}

/// Measured and computed values into their objects.
void Cia402Axis::refresh() {
  set(0x6041, 0, statusword());
  set(0x6061, 0, value(0x6060, 0));
  set(0x6064, 0, static_cast<std::uint32_t>(saturated(reading_.position_rev * settings_.counts_per_turn)));
  set(0x606C, 0,
      static_cast<std::uint32_t>(
          saturated(reading_.velocity_rev_s * 2.0 * std::numbers::pi / settings_.velocity_unit)));
  set(0x6077, 0, static_cast<std::uint32_t>(saturated(acting_torque())));
}

bool Cia402Axis::closed_loop() const {
  return power_ == Power::enabled && value(0x6060, 0) == static_cast<std::uint32_t>(mode_torque);
}

double Cia402Axis::acting_torque() const {
  if (!closed_loop()) return 0.0;
  const auto thousandths = [&](std::uint16_t index) { return static_cast<std::int16_t>(value(index, 0)); };
  const auto limit = objects_.find(key(0x6072, 0));
  const double most = limit != objects_.end() ? limit->second.value : 1000.0 * settings_.max_torque;
  return std::clamp(static_cast<double>(thousandths(0x6071) + thousandths(0x60B2)), -most, most);
}

double Cia402Axis::shaft_torque() const {
  const double rated = value(0x6076, 0) * settings_.rated_torque_unit;
  return acting_torque() / 1000.0 * rated;
}

}  // namespace esmc::host
