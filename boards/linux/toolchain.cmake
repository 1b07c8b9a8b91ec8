# A Linux computer with a CAN interface: this one, or another one by CMAKE_C(XX)_COMPILER.
set(ESMC_BOARD linux CACHE STRING "" FORCE)
