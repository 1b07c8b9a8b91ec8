#pragma once
/// A NUCLEO board as the loop sees it; "chip.hpp" is the board's own.

#include "boards/node.hpp"
#include "chip.hpp"

namespace esmc::stm32 {

class NucleoBoard {
 public:
  /// Pins first, so that outputs are low; then a console that needs no crystal.
  NucleoBoard() {
    Chip::start_pins();
    cause_ = Chip::reset_cause();
    console_.start(Chip::reset_clock_hz);
  }
  /// Clocks, then the bus; what went wrong, or none.
  [[nodiscard]] StartFault start(Word bit_rate) {
    if (const StartFault fault = Chip::start_clocks(); fault != StartFault::none) return fault;
    console_.start(Chip::console_clock_hz);
    start_microseconds(Chip::timer_clock_hz);
    Chip::prepare_can();
    return bus_.open(Chip::can_clock_hz, bit_rate) ? StartFault::none : StartFault::can;
  }

  struct Contact {
    [[nodiscard]] static bool closed() { return Chip::enable.high(); }
  };
  struct DriveEnable {
    static void set(bool on) { Chip::drive_enable.set(on); }
  };
  struct Brake {
    static void set(bool on) { Chip::brake.set(on); }
  };
  struct Watchdog {
    static void refresh() { Chip::watchdog.refresh(); }
  };

  [[nodiscard]] Chip::Can& bus() { return bus_; }
  [[nodiscard]] Watchdog& watchdog() { return watchdog_; }
  [[nodiscard]] Contact& enable() { return contact_; }
  [[nodiscard]] DriveEnable& drive_enable() { return drive_enable_; }
  [[nodiscard]] Brake& brake() { return brake_; }
  /// Of parameters, in bank 2 of the flash. The code lies in bank 1 (memory.ld), and each bank has its own
  /// array and read path: while bank 2 is erased, for 25 ms on a G4 and up to four seconds on an H7,
  /// instructions and constants are fetched from bank 1 as ever. So ticks go on and the independent watchdog
  /// is refreshed by each of them. Only a read of bank 2 would wait, and the driver does not read it then.
  [[nodiscard]] Chip::Slots& slots() { return slots_; }
  [[nodiscard]] Word now_us() const { return microseconds(); }
  [[nodiscard]] Console& console() { return console_; }
  /// Flags of the reset that began this run, as the chip has them.
  [[nodiscard]] Word reset_cause() const { return cause_; }

 private:
  Chip::Can bus_{Chip::CanMemory{}};
  Chip::Slots slots_{{}};
  Console console_{Chip::console};
  Watchdog watchdog_;
  Contact contact_;
  DriveEnable drive_enable_;
  Brake brake_;
  Word cause_ = 0;
};
static_assert(Board<NucleoBoard>);

}  // namespace esmc::stm32
