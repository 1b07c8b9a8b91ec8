# Two interface targets carry the flags, so that nothing is compiled without them (a sanitizer that is linked but
# not compiled in reports success for ever).
#   esmc_warnings  every target of this project
#   esmc_numerics  what decides the last bit of a result; part of the installed interface

add_library(esmc_warnings INTERFACE)
target_compile_options(esmc_warnings INTERFACE
  -Wall -Wextra -Wpedantic -Wconversion -Wsign-conversion -Wdouble-promotion -Wshadow
  $<$<BOOL:${ESMC_WERROR}>:-Werror>)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
  # gcc 12 sees uninitialised reads in Eigen's fixed-size temporaries that do not exist (gcc bug 105562 and kin).
  target_compile_options(esmc_warnings INTERFACE -Wno-maybe-uninitialized)
endif()
if(ESMC_SANITIZE)
  target_compile_options(esmc_warnings INTERFACE -fsanitize=address,undefined -fno-sanitize-recover=all
                         -fno-omit-frame-pointer)
  target_link_options(esmc_warnings INTERFACE -fsanitize=address,undefined)
endif()
if(ESMC_COVERAGE)
  target_compile_options(esmc_warnings INTERFACE --coverage -O0)
  target_link_options(esmc_warnings INTERFACE --coverage)
endif()

# No fused multiply-add behind our back and no packet arithmetic with another order of summation: the same
# numbers from gcc and clang, from x86 and Arm.
add_library(esmc_numerics INTERFACE)
target_compile_options(esmc_numerics INTERFACE -ffp-contract=off -fno-math-errno -fno-trapping-math)
target_compile_definitions(esmc_numerics INTERFACE EIGEN_DONT_VECTORIZE EIGEN_NO_DEBUG)
set_target_properties(esmc_numerics PROPERTIES EXPORT_NAME numerics)
