// The yardstick with the arithmetic of a single run, and with its closure restored: what lanes could do at
// best.
#define ESMC_ROUNDED
#include "tests/benchmarks/batch_yardstick.cpp"  // NOLINT(bugprone-suspicious-include)
