set(ESMC_SCALAR float)
set(ESMC_BAKE_FLAGS "")  # lockstep
set(ESMC_BOARD_SOURCES mps2/main.cpp cortex_m/startup.cpp)
set(ESMC_EMULATED ON)
set(ESMC_DEFAULT_SCENE ${PROJECT_SOURCE_DIR}/host_sim/scenes/five_bar_circle.toml)
set(ESMC_PARTS parts_two_motors parts_four_motors)
