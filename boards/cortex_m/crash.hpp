#pragma once
/// Record of the last unexpected exception of a Cortex-M or Cortex-R. Survives a reset, not a loss of power.

#include <cstdint>

namespace esmc {

/// Word that fills unused stack.
inline constexpr std::uint32_t stack_paint = 0xA5A5'5A5AU;

/// Registers at the last unexpected exception. Valid only while sealed().
struct CrashRecord {
  static constexpr std::uint32_t mark = 0x45534D43U;  // "ESMC"
  std::uint32_t valid;                                ///< sum() of a complete record
  /// 0: none, but a watchdog's reset. M: 2 NMI, 3 hard fault, 4 memory, 5 bus, 6 usage, 16 + n interrupt n;
  /// R: number of its vector.
  std::uint32_t exception;
  std::uint32_t fault_status;  ///< CFSR; R: DFSR
  std::uint32_t hard_status;   ///< HFSR; R: IFSR
  std::uint32_t address;       ///< BFAR, if CFSR declares it valid; R: DFAR, IFAR
  std::uint32_t sp;            ///< at the fault, including the stacked registers
  std::uint32_t pc, lr;        ///< 0: the stack could not be read

  /// The checksum of all fields but `valid`.
  [[nodiscard]] std::uint32_t sum() const {
    return mark ^
           (exception + 3U * fault_status + 5U * address + 13U * sp + 17U * hard_status + 7U * pc + 11U * lr);
  }
  [[nodiscard]] bool sealed() const { return valid == sum(); }  ///< the record is complete
  void seal() { valid = sum(); }  ///< marks the record complete; all fields must be set
  void forget() { valid = 0; }    ///< erases the record: sealed() is then false
};
extern CrashRecord crash_record;

}  // namespace esmc
