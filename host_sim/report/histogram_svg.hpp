#pragma once
/// How numbers are spread, as a figure for the pages of studies.

#include <string>
#include <vector>

namespace esmc::host {

/// `sorted`: finite, ascending, not all equal. Texts without characters that HTML would take for its own.
[[nodiscard]] std::string histogram_svg(const std::string& title, const std::string& x_label,
                                        const std::vector<double>& sorted);

}  // namespace esmc::host
