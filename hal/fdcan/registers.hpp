#pragma once
/// Registers of Bosch's M_CAN as ST builds it in: offsets in bytes from the controller, message memory in
/// words. Sources: RM0440 (STM32G4), RM0433 (STM32H742/743), chapters FDCAN.

#include <cstdint>

#include "hal/bit_timing.hpp"

/// CAN controller of STM32 (FDCAN).
namespace esmc::hal::fdcan {

using Word = std::uint32_t;

// Common to both.
inline constexpr Word dbtp = 0x0C, test = 0x10, cccr = 0x18, nbtp = 0x1C, tscc = 0x20, tscv = 0x24,
                      ecr = 0x40, psr = 0x44, tdcr = 0x48, ir = 0x50, ie = 0x54, ils = 0x58, ile = 0x5C,
                      txbc = 0xC0;

/// Largest values of NBTP (nominal bit rate) and DBTP (data bit rate).
inline constexpr BitTimingLimits nominal_limits{512, 256, 128, 128}, data_limits{32, 32, 16, 16};

/// Timing of arbitration, and with CAN FD of data. There the bit that switches the rate ends soon after the
/// sender's sample point, which must be the receiver's, too: a moteus samples at 67 % (fdcan.cc of its
/// firmware).
[[nodiscard]] constexpr BitTiming nominal_timing(std::uint32_t clock, std::uint32_t bit_rate, bool fd) {
  return bit_timing(clock, bit_rate, nominal_limits, fd ? 3 : 5);
}
[[nodiscard]] constexpr BitTiming data_timing(std::uint32_t clock, std::uint32_t bit_rate) {
  return bit_timing(clock, bit_rate, data_limits, 3);
}

namespace cccr_bit {
inline constexpr Word init = 1U << 0, cce = 1U << 1, restricted = 1U << 2, csr = 1U << 4, mon = 1U << 5,
                      test = 1U << 7, fdoe = 1U << 8, brse = 1U << 9;
}
namespace psr_bit {
inline constexpr Word error_passive = 1U << 5, bus_off = 1U << 7;
}
inline constexpr Word rx_new =
    1U << 0;  ///< IR.RF0N; the flag of a lost frame has a place of its own per chip

/// Elements of the filter lists: classic filters (identifier and mask) into FIFO 0.
namespace filter {
inline constexpr Word standard = (2U << 30) | (1U << 27), extended_first = 1U << 29,
                      extended_second = 2U << 30;
/// GFC, RXGFC: frames that no filter accepts are rejected, of either kind.
inline constexpr Word reject_standard = 2U << 4, reject_extended = 2U << 2;
}  // namespace filter

// First two words of a buffer.
namespace element {
inline constexpr Word extended = 1U << 30, remote = 1U << 29, fd = 1U << 21, bit_rate_switch = 1U << 20;
inline constexpr unsigned standard_shift = 18, dlc_shift = 16;
inline constexpr Word words = 18;  ///< header and 64 bytes
}  // namespace element

/// Registers that differ between chips: STM32G4. Fixed layout of the message memory, in words.
struct G4 {
  static constexpr Word rxf0s = 0x90, rxf0a = 0x94, txbrp = 0xC8, txbar = 0xCC, txbcr = 0xD0, txbto = 0xD4;
  static constexpr Word lost_flag = 1U << 2;  ///< IR.RF0L
  static constexpr Word ram_words = 212, rx_fifo = 44, rx_elements = 3, tx_buffers = 158, tx_elements = 3;
  static constexpr Word standard_filters = 0, extended_filters = 28;
  static constexpr Word fill = 0xF, index = 0x3;  ///< of RXF0S, TXFQS
  /// Configures: accepted frames into FIFO 0, which keeps the old ones when full; transmit queue; clock
  /// undivided. `rejected`: bits of filter::; the lists of filters have `standard` and `extended` elements.
  template <class Access>
  static void configure(Access& a, Word rejected, Word standard, Word extended) {
    a.write(0x80, rejected | (standard << 16) | (extended << 24));  // RXGFC
    a.write(txbc, 1U << 24);                                        // TFQM
    a.write(0x100, 0);                                              // CKDIV
  }
};

/// Registers of STM32H742/743, as in G4. Layout of our own from the start of FDCAN1's message memory.
struct H7 {
  static constexpr Word rxf0s = 0xA4, rxf0a = 0xA8, txbrp = 0xCC, txbar = 0xD0, txbcr = 0xD4, txbto = 0xD8;
  static constexpr Word lost_flag = 1U << 3;
  static constexpr Word rx_fifo = 0, rx_elements = 32, tx_elements = 3,
                        tx_buffers = rx_elements * element::words,
                        standard_filters = tx_buffers + tx_elements * element::words,
                        extended_filters = standard_filters + 28, ram_words = extended_filters + 16;
  static constexpr Word fill = 0x7F, index = 0x3F;
  /// Configures FIFO 0 for accepted frames and the transmit queue; arguments as in G4::configure().
  template <class Access>
  static void configure(Access& a, Word rejected, Word standard, Word extended) {
    a.write(0x80, rejected);                                    // GFC
    a.write(0x84, (standard << 16) | (standard_filters << 2));  // SIDFC
    a.write(0x88, (extended << 16) | (extended_filters << 2));  // XIDFC
    a.write(0xA0, (rx_elements << 16) | (rx_fifo << 2));        // RXF0C: blocking
    a.write(0xB0, 0);                                           // RXF1C: none
    a.write(0xBC, 7);                                           // RXESC: 64 bytes
    a.write(txbc, (1U << 30) | (tx_elements << 24) | (tx_buffers << 2));
    a.write(0xC8, 7);  // TXESC: 64 bytes
    a.write(0xF0, 0);  // TXEFC: no events
  }
};

}  // namespace esmc::hal::fdcan
