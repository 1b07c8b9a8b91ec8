#pragma once
/// Registers of the CAN 2.0B controllers of a Zynq UltraScale+: offsets in bytes from CAN0 (0xFF060000) or
/// CAN1 (0xFF070000). Sources: UG1085, chapter "CAN Controller"; UG1087, module CAN (names in comments).

#include <cstdint>

#include "hal/bit_timing.hpp"

/// CAN controller of Zynq UltraScale+.
namespace esmc::hal::zynqmp_can {

using Word = std::uint32_t;

inline constexpr Word srr = 0x00,  ///< SRR: software reset
    msr = 0x04,                    ///< MSR: mode
    brpr = 0x08,                   ///< BRPR: prescaler
    btr = 0x0C,                    ///< BTR: segments
    sr = 0x18,                     ///< SR: status
    isr = 0x1C,                    ///< ISR: events, cleared by ICR
    ier = 0x20,                    ///< IER: interrupts
    icr = 0x24,                    ///< ICR
    afr = 0x60;                    ///< AFR: acceptance filters
/// First of the four words of a message in TXFIFO and RXFIFO: *_ID, *_DLC, *_DATA1, *_DATA2.
inline constexpr Word tx_fifo = 0x30, rx_fifo = 0x50;

namespace srr_bit {
inline constexpr Word srst = 1U << 0,  ///< reset: registers and FIFOs; ends by itself, in configuration mode
    cen = 1U << 1;                     ///< 0: configuration mode
}
namespace sr_bit {
inline constexpr Word config = 1U << 0, estat = 3U << 7,
                      bus_off = 2U << 7;  ///< ESTAT: 1 active, 3 passive, 2 bus-off
}
namespace event {  // of ISR, ICR
inline constexpr Word txok = 1U << 1, rxoflw = 1U << 6, rxnemp = 1U << 7, bsoff = 1U << 9, all = 0x7FFFU;
}

// A message in its four words.
inline constexpr Word srrrtr = 1U << 20, ide = 1U << 19, rtr = 1U << 0;
inline constexpr unsigned idh_shift = 21, idl_shift = 1, idl_bits = 18, dlc_shift = 28;
inline constexpr Word idl_mask = (1U << idl_bits) - 1U;

/// Largest values of BRPR and of BTR's TS1, TS2, SJW.
inline constexpr BitTimingLimits limits{256, 16, 8, 4};

/// Layout of identifier and data in the words of a message.
enum class Layout : std::uint8_t {
  manual,    ///< UG1085, "CAN Message Format": identifier from bit 31 down, first byte in bits 31..24
  qemu_7_2,  ///< QEMU 7.2's model of the controller: Linux's can_id, first byte in bits 7..0
};

}  // namespace esmc::hal::zynqmp_can
