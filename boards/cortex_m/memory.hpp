#pragma once
/// Memory at start-up, of Cortex-M and Cortex-R, by the symbols of sections.ld.

#include "boards/cortex_m/crash.hpp"

extern "C" {
extern std::uint32_t esmc_stack_top, esmc_hot_begin, esmc_hot_end, esmc_data_begin, esmc_data_end,
    esmc_bss_begin, esmc_bss_end, esmc_stack_bottom;
extern const std::uint32_t esmc_hot_image, esmc_data_image;

/// The program of an image; startup calls it once after reset, with the memory set up.
[[noreturn]] void esmc_main();
/// The handler of interrupt ESMC_CAN_INTERRUPT, which board.cmake defines for boards that have one.
void esmc_can_interrupt();
}

namespace esmc {

/// Copies hot code, sets initialised data and clears .bss; paints the unused stack, so that its deepest use
/// can be read later. Call first after a reset: before it no static variable has its value, and no C++
/// function may be called.
[[gnu::always_inline]] inline void prepare_memory() {
  const std::uint32_t* from = &esmc_hot_image;
  for (std::uint32_t* to = &esmc_hot_begin; to < &esmc_hot_end;) *to++ = *from++;
  from = &esmc_data_image;
  for (std::uint32_t* to = &esmc_data_begin; to < &esmc_data_end;) *to++ = *from++;
  for (std::uint32_t* to = &esmc_bss_begin; to < &esmc_bss_end;) *to++ = 0;
  std::uint32_t* here = nullptr;
  asm volatile("mov %0, sp" : "=r"(here));
  for (volatile std::uint32_t* to = &esmc_stack_bottom; to < here; ++to) *to = stack_paint;
}

}  // namespace esmc
