# Common part of the bare-metal Arm toolchain files: a board file sets ESMC_BOARD and ESMC_CPU_FLAGS first.
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_CXX_COMPILER arm-none-eabi-g++)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
set(CMAKE_CXX_FLAGS_INIT "${ESMC_CPU_FLAGS} -fno-exceptions -fno-rtti -fno-threadsafe-statics -ffunction-sections -fdata-sections")
# Eigen is header-only: the host's copy serves.
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
