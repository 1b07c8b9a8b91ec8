# Arm MPS2 with FPGA image AN386: Cortex-M4F, single precision. QEMU's machine mps2-an386.
set(ESMC_BOARD mps2_an386 CACHE STRING "" FORCE)
set(CMAKE_SYSTEM_PROCESSOR cortex-m4)
set(ESMC_CPU_FLAGS "-mcpu=cortex-m4 -mthumb -mfpu=fpv4-sp-d16 -mfloat-abi=hard")
include(${CMAKE_CURRENT_LIST_DIR}/../arm_none_eabi.cmake)
