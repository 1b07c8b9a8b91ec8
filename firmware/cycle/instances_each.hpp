#pragma once
/// Instantiations in the control archive: ESMC_EACH(DEFINE) is DEFINE of every mechanism and scalar type,
/// ESMC_EACH_REDUNDANT(DEFINE) of those whose joints can all have motors and encoders. A board has one scalar
/// type (firmware/CMakeLists.txt).

#include "firmware/mechanism/five_bar.hpp"
#include "firmware/mechanism/rr.hpp"

/// @cond
#ifdef ESMC_ONLY_FLOAT
#define ESMC_IN_DOUBLE(DEFINE, MECHANISM) static_assert(true)
#else
#define ESMC_IN_DOUBLE(DEFINE, MECHANISM) DEFINE(MECHANISM<double>)
#endif
#ifdef ESMC_ONLY_DOUBLE
#define ESMC_IN_FLOAT(DEFINE, MECHANISM) static_assert(true)
#else
#define ESMC_IN_FLOAT(DEFINE, MECHANISM) DEFINE(MECHANISM<float>)
#endif
#define ESMC_EACH_REDUNDANT(DEFINE) \
  ESMC_IN_DOUBLE(DEFINE, FiveBar);  \
  ESMC_IN_FLOAT(DEFINE, FiveBar)
#define ESMC_EACH(DEFINE)      \
  ESMC_EACH_REDUNDANT(DEFINE); \
  ESMC_IN_DOUBLE(DEFINE, Rr);  \
  ESMC_IN_FLOAT(DEFINE, Rr)
/// @endcond
