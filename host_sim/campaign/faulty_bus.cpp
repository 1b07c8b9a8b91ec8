#include "host_sim/campaign/faulty_bus.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <limits>

#include "host_sim/bus/wire.hpp"

namespace esmc::host {

void FaultyBus::begin_tick(bool active) {
  active_ = active;
  ++tick_;
  ms_ = 0.0;
  to_drives_.clear();
}

void FaultyBus::from_drive(std::size_t axis, const hal::CanFrame& f) {
  const Injected kind = injection_->kind();
  if (active_ && (kind == Injected::controller_bus_off || kind == Injected::babbling)) return;
  if (active_ && kind == Injected::scattered_loss && draw_.uniform() < injection_->amount) return;
  if (active_ && axis == injection_->drive) return faulty(f);
  up(f);
}

/// A frame of the drive that the fault afflicts.
void FaultyBus::faulty(const hal::CanFrame& f) {
  switch (injection_->kind()) {
    case Injected::loss:
    case Injected::drive_silent:
    case Injected::drive_bus_off:
      return;
    case Injected::heartbeat_lost:
      if (!traits_->is_heartbeat(f, node())) up(f);
      return;
    case Injected::duplication:
      up(f);
      return up(f);
    case Injected::delay:
      late_.emplace_back(tick_ + static_cast<std::uint64_t>(std::max(0.0, injection_->amount)), f);
      return;
    case Injected::reordering:  // every second one is overtaken by the next
      if (tick_ % 2 != 0) return up(f);
      late_.emplace_back(tick_ + 1, f);
      return;
    default:
      return up(mangled(f));
  }
}

hal::CanFrame FaultyBus::mangled(hal::CanFrame f) {
  constexpr float inf = std::numeric_limits<float>::infinity();
  constexpr std::array<float, 4> not_numbers{std::numeric_limits<float>::quiet_NaN(), inf, -inf,
                                             std::bit_cast<float>(0xFFA0'0001U)};
  const auto choice = static_cast<unsigned>(injection_->choice);
  const int which = injection_->choice % 2;
  const Injected kind = injection_->kind();
  if (kind != Injected::corruption && kind != Injected::extended && !traits_->is_sample(f, node())) return f;
  switch (kind) {
    case Injected::corruption:
      for (int n = draw_.between(1, 8); n > 0 && f.size > 0; --n) {
        f.data[draw_.below(f.size)] ^= static_cast<std::uint8_t>(1U << draw_.below(8));
      }
      break;
    case Injected::not_finite:
      traits_->put_number(f, which, not_numbers[choice / 2 % 4]);
      break;
    case Injected::denormal:
    case Injected::huge:
      traits_->put_number(f, which, static_cast<float>(injection_->amount));
      break;
    case Injected::end_of_range:
      traits_->put_end(f, choice);
      break;
    case Injected::wrong_length:
      f.size = traits_->wrong_size(f, draw_.bits());
      break;
    case Injected::remote:
      f.remote = true;
      break;
    case Injected::flexible_rate:
      f.fd = !f.fd;  // of a drive that speaks CAN FD: a classic frame
      f.bit_rate_switch = f.fd && which == 0;
      if (!f.fd) f.size = std::min(f.size, hal::can_classic_size_max);
      if (f.fd && choice % 4 > 1) f.size = hal::can_fd_size_max;
      break;
    case Injected::extended:
      f.extended = true;
      break;
    default:
      break;
  }
  return f;
}

void FaultyBus::from_stranger(const hal::CanFrame& f) {
  up(f);
  to_drives_.push_back({f, ms_, false});
}

void FaultyBus::inject_foreign_frames() {
  while (!late_.empty() && late_.front().first <= tick_) {
    up(late_.front().second);
    late_.pop_front();
  }
  if (!active_ || injection_->kind() != Injected::flood) return;
  for (int n = 0; n < static_cast<int>(injection_->amount); ++n) {
    hal::CanFrame f;
    f.id = 0x1FFF'0000U + static_cast<std::uint32_t>(draw_.below(16));  // no drive here answers to these
    f.extended = true;
    f.size = static_cast<std::uint8_t>(draw_.below(9));
    up(f);
  }
}

void FaultyBus::inject_foreign_frames_after_tick(const hal::CanFrame& foreign) {
  if (!active_) return;
  if (injection_->kind() == Injected::emergency_stop) {
    from_stranger(traits_->emergency_stop(node()));
  }
  if (injection_->kind() == Injected::foreign_controller) from_stranger(foreign);
}

hal::SendStatus FaultyBus::try_send(const hal::CanFrame& f) {
  if (!hal::well_formed(f)) return hal::SendStatus::refused;
  const Injected kind = injection_->kind();
  if (active_ && kind == Injected::controller_bus_off) return hal::SendStatus::bus_off;
  if (active_ && (kind == Injected::babbling || kind == Injected::queue_full))
    return hal::SendStatus::bus_full;
  ms_ += worst_bits(f, fast_bit_) / bits_per_ms_;
  const bool lost = active_ && (kind == Injected::commands_lost ||
                                (kind == Injected::scattered_loss && draw_.uniform() < injection_->amount) ||
                                (kind == Injected::torque_lost && traits_->is_torque(f, node())));
  if (lost) return hal::SendStatus::ok;
  to_drives_.push_back({f, ms_, true});
  if (active_ && kind == Injected::duplication) to_drives_.push_back({f, ms_, true});
  return hal::SendStatus::ok;
}

bool FaultyBus::try_receive(hal::CanFrame& f) {
  auto& from = orders_.empty() ? to_controller_ : orders_;
  if (from.empty()) return false;
  f = from.front();
  from.pop_front();
  return true;
}

}  // namespace esmc::host
