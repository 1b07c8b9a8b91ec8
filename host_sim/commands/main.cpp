#include <fstream>
#include <iostream>
#include <sstream>
#include "host_sim/commands/eval.hpp"
int main(int argc, char** argv) {
  std::ifstream f(argv[1]); std::stringstream s; s << f.rdbuf();
  std::cout << esmc::host::evaluate(s.str(), argv[1], argc > 2 ? esmc::host::ScalarType::single_precision : esmc::host::ScalarType::double_precision).dump(1) << "\n";
}
