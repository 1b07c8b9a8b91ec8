# ST NUCLEO-H743ZI2: Cortex-M7, double-precision FPU.
set(ESMC_BOARD nucleo_h743zi2 CACHE STRING "" FORCE)
set(CMAKE_SYSTEM_PROCESSOR cortex-m7)
set(ESMC_CPU_FLAGS "-mcpu=cortex-m7 -mthumb -mfpu=fpv5-d16 -mfloat-abi=hard")
include(${CMAKE_CURRENT_LIST_DIR}/../arm_none_eabi.cmake)
