#include "host_sim/bus/timed_bus.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace esmc::host {
namespace {

constexpr int recovery_sequences = 128;
constexpr TimedBus::Time recovery_bits = 11;  // recessive bits per sequence
constexpr std::uint32_t bits_after_ack = 8;   // acknowledge delimiter and end of frame

constexpr std::uint32_t mask(std::size_t node) { return 1U << node; }
template <class F>
void for_each_node(std::uint32_t nodes, const F& f) {
  for (; nodes != 0; nodes &= nodes - 1) f(static_cast<std::size_t>(std::countr_zero(nodes)));
}

}  // namespace

TimedBus::TimedBus(const Config& c)
    : bitrate_(c.bitrate),
      fast_bit_(c.fast_bit),
      timed_(find_effect<BitTiming>(c.effects).has_value()),
      loss_(find_effect<Loss>(c.effects)),
      duplication_(find_effect<Duplication>(c.effects)),
      corruption_(find_effect<Corruption>(c.effects)),
      babbler_(find_effect<BabblingNode>(c.effects)),
      off_(find_effect<BusOff>(c.effects)),
      dropout_(find_effect<DriveDropout>(c.effects)),
      loss_random_(c.seed, Stream::bus_loss),
      duplication_random_(c.seed, Stream::bus_duplication),
      corruption_random_(c.seed, Stream::bus_corruption),
      babble_random_(c.seed, Stream::babbling_node),
      nodes_(c.drives + 1 + (babbler_ ? 1 : 0)) {
  for (Node& n : nodes_) n.queue.reserve(queue_frames);
}

bool TimedBus::during(const Span& s) const {
  if (!origin_) return s.from < 0.0;
  const double t = seconds(now_ - *origin_);
  return t >= s.from && t < s.to;
}

bool TimedBus::connected(std::size_t node) const {
  return !dropout_ || node != static_cast<std::size_t>(dropout_->drive) || !during(dropout_->when);
}

/// Brings a node up to the present time.
void TimedBus::refresh(std::size_t node) {
  Node& n = nodes_[node];
  if (off_ && !was_off_ && node == static_cast<std::size_t>(off_->drive) && origin_ &&
      seconds(now_ - *origin_) >= off_->at) {
    was_off_ = true;
    n.errors.give_up();
    n.queue.clear();
    if (off_->restart) restart(node);
  }
  if (!n.restarting || flight_) return;
  const Time idle = std::max<Time>(0, now_ - n.recessive_from);
  if (n.sequences + idle / recovery_bits < recovery_sequences) return;
  n.restarting = false;
  n.errors.reset();
}

bool TimedBus::online(std::size_t node) {
  refresh(node);
  return nodes_[node].errors.state() != ErrorCounters::State::off && connected(node);
}

void TimedBus::restart(std::size_t node) {
  Node& n = nodes_[node];
  if (n.errors.state() != ErrorCounters::State::off || n.restarting) return;
  n.restarting = true;
  n.sequences = 0;
  n.recessive_from = std::max(now_, free_);
}

ErrorCounters TimedBus::counters(std::size_t node) {
  refresh(node);
  return nodes_[node].errors;
}

hal::SendStatus TimedBus::send(std::size_t node, const hal::CanFrame& f) {
  if (!hal::well_formed(f) || (f.fd && fast_bit_ == 0.0)) return hal::SendStatus::refused;
  Node& n = nodes_[node];
  if (!online(node) || n.queue.size() == queue_frames) {
    ++counts_.refused;
    if (n.errors.state() == ErrorCounters::State::off) return hal::SendStatus::bus_off;
    if (!connected(node)) n.queue.clear();  // nothing old when it comes back
    return hal::SendStatus::bus_full;
  }
  n.queue.push_back({f, arbitration(f), now_, false});
  return hal::SendStatus::ok;
}

TimedBus::Pending* TimedBus::front(Node& n) {
  const auto first = std::ranges::min_element(n.queue, {}, &Pending::key);
  return first == n.queue.end() ? nullptr : &*first;
}

/// Instant of the babbling node's next frame; it holds one at a time.
std::optional<TimedBus::Time> TimedBus::babble_time() const {
  if (!babbler_ || !nodes_.back().queue.empty()) return std::nullopt;
  if (!origin_) return babbler_->when.from < 0.0 ? std::optional(std::max(now_, babble_at_)) : std::nullopt;
  const auto instant = [&](double t) {
    return *origin_ + static_cast<Time>(std::ceil(std::clamp(t, -1e9, 1e9) * bitrate_));
  };
  const Time at = std::max({now_, babble_at_, instant(babbler_->when.from)});
  return at < instant(babbler_->when.to) ? std::optional(at) : std::nullopt;
}

void TimedBus::babble() {
  const auto at = babble_time();
  if (!at || *at > now_ || !online(nodes_.size() - 1)) return;
  hal::CanFrame f;
  f.id = babbler_->identifier;
  f.extended = babbler_->extended;
  f.size = static_cast<std::uint8_t>(babbler_->size);
  for (int i = 0; i < babbler_->size; ++i)
    f.data[static_cast<std::size_t>(i)] = static_cast<std::uint8_t>(babble_random_.below(256));
  nodes_.back().queue.push_back({f, arbitration(f), now_, false});
  babble_at_ = now_ + std::max<Time>(1, std::llround(bitrate_ / babbler_->rate_hz));
}

/// The first instant from now on at which a node begins to send.
std::optional<TimedBus::Time> TimedBus::next_start() {
  std::optional<Time> at;
  const auto candidate = [&](Time t) { at = at ? std::min(*at, t) : t; };
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    if (!nodes_[i].queue.empty() && online(i) && !nodes_[i].queue.empty())
      candidate(std::max({now_, free_, nodes_[i].not_before}));
  }
  if (const auto b = babble_time(); b && online(nodes_.size() - 1))
    candidate(std::max({*b, free_, nodes_.back().not_before}));
  return at;
}

std::optional<TimedBus::Delivery> TimedBus::next(Time until) {
  for (;;) {
    if (flight_) {
      if (flight_->end > until) break;
      now_ = flight_->end;
      if (auto d = finish()) return d;
      continue;
    }
    const auto at = next_start();
    if (!at || *at >= until) break;
    now_ = *at;
    start();
  }
  now_ = std::max(now_, until);
  return std::nullopt;
}

bool TimedBus::quiet() {
  if (flight_) return false;
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    if (!nodes_[i].queue.empty() && online(i)) return false;
  }
  const auto b = babble_time();
  return !b || *b > now_;
}

void TimedBus::start() {
  babble();
  std::uint32_t least = 0xFFFF'FFFF, contenders = 0, present = 0;
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    if (!online(i)) continue;
    present |= mask(i);
    const Pending* p = front(nodes_[i]);
    if (p == nullptr || nodes_[i].not_before > now_ || p->key > least) continue;
    contenders = p->key < least ? mask(i) : contenders | mask(i);
    least = p->key;
  }
  if (contenders == 0) return;
  for (Node& n : nodes_) {
    if (n.restarting)
      n.sequences += static_cast<int>(std::max<Time>(0, now_ - n.recessive_from) / recovery_bits);
  }
  Flight f;
  f.begin = now_;
  f.receivers = present & ~contenders;
  f.senders = contenders;
  Time collision = 0;
  if (std::popcount(contenders) > 1) collision = settle_collision(f);
  f.what = *front(nodes_[static_cast<std::size_t>(std::countr_zero(f.senders))]);
  f.bits = exact_bits(f.what.frame, fast_bit_);
  const Time length = f.bits - interframe_bits;
  f.end = now_ + (timed_ ? length : 0);
  const bool disturbed =
      corruption_ && during(corruption_->when) && corruption_random_() < corruption_->detected;
  if (f.outcome == Outcome::collided) {
    f.end = now_ + (timed_ ? collision : 0);
  } else if (disturbed) {
    f.outcome = Outcome::disturbed;
    const auto bit = static_cast<Time>(corruption_random_.below(static_cast<std::uint32_t>(length))) + 1;
    f.end = now_ + (timed_ ? bit : 0);
  } else if (f.receivers == 0) {
    f.outcome = Outcome::unacknowledged;
    f.end = now_ + (timed_ ? length - bits_after_ack : 0);
  }
  flight_ = f;
}

/// Several nodes send the same identifier: they go on until a bit in which they differ. Who sends recessive
/// there sees a bit error. Its error flag ends the frame for all, unless it is passive: then it only drops
/// out. Returns the bits until then.
TimedBus::Time TimedBus::settle_collision(Flight& f) {
  while (std::popcount(f.senders) > 1) {
    std::vector<WireFrame> wire;
    std::vector<std::size_t> who;
    for_each_node(f.senders, [&](std::size_t i) {
      wire.push_back(on_the_wire(front(nodes_[i])->frame));
      who.push_back(i);
    });
    std::uint32_t bit = 0;
    const auto differs = [&] {
      return std::ranges::any_of(wire,
                                 [&](const WireFrame& w) { return w.bit[bit] != wire.front().bit[bit]; });
    };
    while (bit < wire.front().size && !differs()) ++bit;
    if (bit == wire.front().size) return 0;  // equal frames are one
    std::uint32_t recessive = 0;
    bool flag = false;
    for (std::size_t k = 0; k < who.size(); ++k) {
      if (!wire[k].bit[bit]) continue;
      recessive |= mask(who[k]);
      flag = flag || nodes_[who[k]].errors.state() == ErrorCounters::State::active;
    }
    if (flag) {
      f.outcome = Outcome::collided;
      return wire.front().until(bit, fast_bit_);
    }
    f.losers |= recessive;
    f.senders &= ~recessive;
  }
  return 0;
}

std::optional<TimedBus::Delivery> TimedBus::finish() {
  const Flight f = *flight_;
  flight_.reset();
  for_each_node(f.losers, [&](std::size_t i) { blame(i); });
  if (f.outcome == Outcome::good) return deliver(f);
  ++counts_.errors;
  for_each_node(f.senders, [&](std::size_t i) {
    // A passive node that misses the acknowledgement only: a lonely node does not leave the bus.
    const bool lonely =
        f.outcome == Outcome::unacknowledged && nodes_[i].errors.state() == ErrorCounters::State::passive;
    if (!lonely) blame(i);
  });
  for_each_node(f.receivers, [&](std::size_t i) { nodes_[i].errors.receive_error(); });
  end_frame(f, error_frame_bits);
  return std::nullopt;
}

/// A transmission of the node has failed.
void TimedBus::blame(std::size_t node) {
  Node& n = nodes_[node];
  n.errors.transmit_error();
  if (n.errors.state() == ErrorCounters::State::off) n.queue.clear();
}

TimedBus::Delivery TimedBus::deliver(const Flight& f) {
  Delivery d{now_, f.what.frame, f.receivers, f.bits, f.what.asked};
  const bool twice = duplication_ && !f.what.again && during(duplication_->when) &&
                     duplication_random_() < duplication_->probability;
  for_each_node(f.senders, [&](std::size_t i) {
    Node& n = nodes_[i];
    const auto p = std::ranges::find(n.queue, f.what.key, &Pending::key);
    if (p == n.queue.end()) return;  // it left the bus meanwhile
    if (twice) {
      p->again = true;
      blame(i);
    } else {
      n.errors.sent();
      n.queue.erase(p);
    }
  });
  for_each_node(f.receivers, [&](std::size_t i) { nodes_[i].errors.received(); });
  if (corruption_ && during(corruption_->when) && corruption_random_() < corruption_->undetected)
    corrupt(d.frame);
  if (loss_ && during(loss_->when)) {
    for_each_node(f.receivers, [&](std::size_t i) {
      if (!(i == controller ? loss_->at_controller : loss_->at_drives)) return;
      if (!(loss_random_() < loss_->probability)) return;
      d.receivers &= ~mask(i);
      ++counts_.missed;
    });
  }
  if (twice) ++counts_.duplicated;
  if (!f.what.again) account(f.what);
  end_frame(f, twice ? error_frame_bits : (timed_ ? interframe_bits : 0));
  return d;
}

void TimedBus::corrupt(hal::CanFrame& f) {
  if (f.size == 0 || f.remote) return;
  for (int k = 0; k < corruption_->bits; ++k) {
    const std::uint32_t bit = corruption_random_.below(8U * f.size);
    f.data[bit / 8] = static_cast<std::uint8_t>(f.data[bit / 8] ^ (1U << (bit % 8)));
  }
  ++counts_.corrupted;
}

/// After the last bit of a frame, or of what was sent of it: `trailing` bits until the next one may begin.
void TimedBus::end_frame(const Flight& f, std::uint32_t trailing) {
  free_ = now_ + trailing;
  busy_ += f.outcome == Outcome::good ? f.bits : static_cast<std::uint64_t>(now_ - f.begin);
  if (trailing == error_frame_bits) busy_ += error_frame_bits;
  for_each_node(f.senders | f.losers, [&](std::size_t i) {
    if (nodes_[i].errors.state() == ErrorCounters::State::passive)
      nodes_[i].not_before = free_ + suspend_bits;
  });
  for (Node& n : nodes_) {
    if (!n.restarting) continue;
    ++n.sequences;  // a delimiter, what follows it and the interframe space are eleven
    n.recessive_from = free_;
  }
}

void TimedBus::account(const Pending& p) {
  auto at = std::ranges::find(latency_, p.key, &Latency::key);
  if (at == latency_.end()) at = latency_.insert(at, {p.key, p.frame.id, p.frame.extended, 0, 0, 0});
  ++at->frames;
  at->largest = std::max(at->largest, now_ - p.asked);
  at->sum += now_ - p.asked;
}

}  // namespace esmc::host
