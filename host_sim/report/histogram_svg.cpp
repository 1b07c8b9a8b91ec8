#include "host_sim/report/histogram_svg.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstddef>

namespace esmc::host {

std::string histogram_svg(const std::string& title, const std::string& x_label,
                          const std::vector<double>& sorted) {
  constexpr std::size_t bins = 60;
  constexpr double width = 640, height = 200, left = 70, right = 20, top = 34, bottom = 44;
  const double low = sorted.front(), span = sorted.back() - low;
  std::array<std::size_t, bins> count{};
  for (const double v : sorted)
    ++count[std::min(bins - 1, static_cast<std::size_t>((v - low) / span * bins))];
  const auto most = static_cast<double>(*std::max_element(count.begin(), count.end()));
  std::string out = fmt::format(
      "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {} {}' role='img' aria-label='{}'><text x='{}' "
      "y='20' "
      "class='title'>{}</text>",
      width, height, title, left, title);
  constexpr double bar = (width - left - right) / bins;
  for (std::size_t i = 0; i < bins; ++i) {
    const double h = (height - top - bottom) * static_cast<double>(count[i]) / most;
    out += fmt::format("<rect x='{:.1f}' y='{:.1f}' width='{:.1f}' height='{:.1f}' fill='#0072b2'/>",
                       left + bar * static_cast<double>(i), height - bottom - h, bar - 1, h);
  }
  out += fmt::format("<path class='grid' d='M{} {}H{}'/><text x='{}' y='{}' text-anchor='end'>{:g}</text>",
                     left, height - bottom, width - right, left - 6, top + 10, most);
  const double base = height - bottom + 16;
  out += fmt::format("<text x='{}' y='{}'>{:.3g}</text><text x='{}' y='{}' text-anchor='end'>{:.3g}</text>",
                     left, base, low, width - right, base, sorted.back());
  return out + fmt::format("<text x='{}' y='{}' text-anchor='middle'>{}</text></svg>\n",
                           (left + width - right) / 2, height - 10, x_label);
}

}  // namespace esmc::host
