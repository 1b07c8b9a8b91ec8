#include "host_sim/report/report.hpp"

#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string_view>

namespace esmc::host {

extern const std::string_view report_template;  // report.html.in, embedded by embed.cmake

namespace {

constexpr std::string_view placeholder = "/*ESMC_DATA*/";

/// JSON text that an HTML parser cannot mistake for markup. In JSON `<` occurs only inside strings, where
/// \u003c means the same; without it there is neither `</script>` nor `<!--`.
std::string json_for_html(const nlohmann::ordered_json& data) {
  const std::string plain =
      data.dump(-1, ' ', /*ensure_ascii=*/false, nlohmann::ordered_json::error_handler_t::replace);
  std::string safe;
  safe.reserve(plain.size() + 64);
  for (const char c : plain) c == '<' ? safe.append("\\u003c") : safe.append(1, c);
  return safe;
}

}  // namespace

std::string render_report(const nlohmann::ordered_json& data) {
  const std::size_t at = report_template.find(placeholder);
  if (at == std::string_view::npos || report_template.rfind(placeholder) != at) {
    throw std::logic_error("report.html.in must contain its placeholder exactly once");
  }
  std::string page(report_template.substr(0, at));
  page += json_for_html(data);
  page += report_template.substr(at + placeholder.size());
  return page;
}

}  // namespace esmc::host
