# ST NUCLEO-G474RE: Cortex-M4F, single-precision FPU.
set(ESMC_BOARD nucleo_g474re CACHE STRING "" FORCE)
set(CMAKE_SYSTEM_PROCESSOR cortex-m4)
set(ESMC_CPU_FLAGS "-mcpu=cortex-m4 -mthumb -mfpu=fpv4-sp-d16 -mfloat-abi=hard")
include(${CMAKE_CURRENT_LIST_DIR}/../arm_none_eabi.cmake)
