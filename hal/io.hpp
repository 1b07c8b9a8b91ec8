#pragma once
/// Interfaces of a board besides CAN and time.

#include <concepts>

namespace esmc::hal {

/// Resets the processor unless refresh() comes in time: only after a tick with Cycle::output_ok().
template <class W>
concept Watchdog = requires(W& w) {
  w.refresh();
};

/// The input `enable`, a normally closed contact. closed() is false for an open contact or a broken wire.
template <class I>
concept DigitalInput = requires(const I& i) {
  { i.closed() } -> std::same_as<bool>;
};

/// An output, `drive_enable` or a brake that opens with power: set(true) is high. Low after reset.
template <class O>
concept DigitalOutput = requires(O& o, bool high) {
  o.set(high);
};

}  // namespace esmc::hal
