set(ESMC_SCALAR float)
set(ESMC_BAKE_FLAGS --realtime --board nucleo_g474re)
set(ESMC_BOARD_DEFINITIONS ESMC_CAN_INTERRUPT=21)  # FDCAN1_IT0
set(ESMC_BOARD_SOURCES stm32/main.cpp cortex_m/startup.cpp nucleo_g474re/damaged_flash.cpp)
set(ESMC_DEFAULT_SCENE ${PROJECT_SOURCE_DIR}/boards/five_bar.toml)
set(ESMC_OPENOCD board/st_nucleo_g4.cfg)
