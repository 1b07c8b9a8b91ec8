set(ESMC_SCALAR double)
set(ESMC_BAKE_FLAGS "")  # lockstep
set(ESMC_BOARD_SOURCES zcu102_rpu/main.cpp zcu102_rpu/startup.cpp)
set(ESMC_DEFAULT_SCENE ${PROJECT_SOURCE_DIR}/host_sim/scenes/five_bar_circle.toml)
option(ESMC_CAN_OF_QEMU "Frames as QEMU 7.2's CAN controller has them; off: as the manual says" ON)
set(ESMC_BOARD_DEFINITIONS ESMC_CAN_OF_QEMU=$<BOOL:${ESMC_CAN_OF_QEMU}>)
set(ESMC_CRASH_SOURCES ${PROJECT_SOURCE_DIR}/tests/boards/crash_r5f.cpp zcu102_rpu/startup.cpp)
