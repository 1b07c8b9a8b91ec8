#pragma once
/// Interfaces of a board besides CAN and time.

#include <concepts>

namespace esmc::hal {

/// Resets the processor unless refreshed in time: after a tick with Cycle::output_ok() only.
template <class W>
concept Watchdog = requires(W& w) {
  w.refresh();
};

/// `enable`: a normally closed contact. An open one, or a broken wire, reads false.
template <class I>
concept DigitalInput = requires(const I& i) {
  { i.closed() } -> std::same_as<bool>;
};

/// `drive_enable`, and a brake that opens with power: low without power, low after reset.
template <class O>
concept DigitalOutput = requires(O& o, bool high) {
  o.set(high);
};

}  // namespace esmc::hal
