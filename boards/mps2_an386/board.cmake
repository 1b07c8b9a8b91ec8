set(ESMC_SCALAR float)
set(ESMC_BAKE_FLAGS --lockstep)
# The emulator lets an instruction last 8 ns and has no idle: beside a plant a tick takes it 50 ms, and 1024 would be read for minutes.
set(ESMC_CAPTURE_TICKS 32)
set(ESMC_BOARD_SOURCES mps2/main.cpp cortex_m/startup.cpp)
set(ESMC_EMULATED ON)
set(ESMC_DEFAULT_SCENE ${PROJECT_SOURCE_DIR}/host_sim/scenes/five_bar_circle.toml)
set(ESMC_IMAGES boards/parts_two_motors boards/parts_four_motors vcan/command)
