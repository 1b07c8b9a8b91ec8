set(ESMC_SCALAR double)
set(ESMC_BAKE_FLAGS --realtime --board nucleo_h743zi2)
set(ESMC_BOARD_DEFINITIONS ESMC_CAN_INTERRUPT=19)  # FDCAN1_IT0
set(ESMC_BOARD_SOURCES stm32/main.cpp cortex_m/startup.cpp)
set(ESMC_DEFAULT_SCENE ${PROJECT_SOURCE_DIR}/boards/five_bar.toml)
set(ESMC_OPENOCD board/st_nucleo_h743zi.cfg)
