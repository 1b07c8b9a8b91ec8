#pragma once
/// `esmc eval`: the model and the laws at given states, for comparison with golden data.

#include <string>

namespace esmc::host {

/// Evaluates every case of a document in the schema of tests/reference/README.md and returns the text of
/// {"cases": [...]} with the computed blocks under the same names. Throws InputError naming file, line, case.
std::string evaluate(const std::string& text, const std::string& file, bool single_precision);

}  // namespace esmc::host
