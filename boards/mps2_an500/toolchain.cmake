# Arm MPS2 with FPGA image AN500: Cortex-M7, double precision. QEMU's machine mps2-an500.
set(ESMC_BOARD mps2_an500 CACHE STRING "" FORCE)
set(CMAKE_SYSTEM_PROCESSOR cortex-m7)
set(ESMC_CPU_FLAGS "-mcpu=cortex-m7 -mthumb -mfpu=fpv5-d16 -mfloat-abi=hard")
include(${CMAKE_CURRENT_LIST_DIR}/../arm_none_eabi.cmake)
