# AMD ZCU102, real-time processor of its Zynq UltraScale+: Cortex-R5F, double precision. QEMU's machine xlnx-zcu102.
set(ESMC_BOARD zcu102_rpu CACHE STRING "" FORCE)
set(CMAKE_SYSTEM_PROCESSOR cortex-r5)
set(ESMC_CPU_FLAGS "-mcpu=cortex-r5 -mthumb -mfpu=vfpv3-d16 -mfloat-abi=hard")
include(${CMAKE_CURRENT_LIST_DIR}/../arm_none_eabi.cmake)
