/// What the laws cost in float.

#include "tests/benchmarks/laws.hpp"

namespace esmc::bench {

void add_laws_in_float(bool counted) {
  add_law(counted, "law/five_bar/esmc/float", law_five_bar<LawKind::esmc, float>);
  add_law(counted, "law/five_bar/esmc_projected/float", law_five_bar<LawKind::esmc_projected, float>);
}

}  // namespace esmc::bench
