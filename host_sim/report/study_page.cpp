#include "host_sim/report/study_page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace esmc::host {
namespace {

constexpr double width = 640, height = 400, left = 70, right = 170, top = 34, bottom = 50;
// Okabe and Ito: told apart by every kind of colour vision, on white and on black.
constexpr const char* colours[] = {"#0072b2", "#d55e00", "#009e73", "#cc79a7",
                                   "#e69f00", "#56b4e9", "#999999", "#b8a800"};

std::string escaped(const std::string& s) {
  std::string out;
  for (const char c : s) {
    switch (c) {
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '&':
        out += "&amp;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

struct Axis {
  int first = 0, last = 1;  ///< decades
  double from = 0.0, to = 1.0;

  [[nodiscard]] double at(double v) const {
    return from + (to - from) * (std::log10(v) - first) / (last - first);
  }
};

std::string marker(std::size_t kind, double x, double y, const char* colour) {
  switch (kind % 3) {
    case 0:
      return fmt::format("<circle cx='{:.1f}' cy='{:.1f}' r='3' fill='{}'/>", x, y, colour);
    case 1:
      return fmt::format("<rect x='{:.1f}' y='{:.1f}' width='6' height='6' fill='{}'/>", x - 3, y - 3,
                         colour);
    default:
      return fmt::format("<path d='M{:.1f} {:.1f}l4 7h-8z' fill='{}'/>", x, y - 4, colour);
  }
}

bool drawable(const std::pair<double, double>& p) {
  return p.first > 0.0 && p.second > 0.0 && std::isfinite(p.first) && std::isfinite(p.second);
}

}  // namespace

std::string log_log_svg(const std::string& title, const std::string& x_label, const std::string& y_label,
                        const std::vector<Series>& series) {
  double x0 = 1e300, x1 = 0.0, y0 = 1e300, y1 = 0.0;
  for (const Series& s : series) {
    for (const auto& p : s.points) {
      if (!drawable(p)) continue;
      x0 = std::min(x0, p.first);
      x1 = std::max(x1, p.first);
      y0 = std::min(y0, p.second);
      y1 = std::max(y1, p.second);
    }
  }
  if (!(x1 > 0.0)) return "";
  const auto axis = [](double low, double high, double from, double to) {
    const int first = static_cast<int>(std::floor(std::log10(low)));
    return Axis{first, std::max(first + 1, static_cast<int>(std::ceil(std::log10(high)))), from, to};
  };
  const Axis x = axis(x0, x1, left, width - right), y = axis(y0, y1, height - bottom, top);
  std::string out = fmt::format(
      "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {} {}' role='img' aria-label='{}'><text x='{}' "
      "y='20' class='title'>{}</text>",
      width, height, escaped(title), left, escaped(title));
  const auto ticks = [&](const Axis& a, bool horizontal) {
    const int every = std::max(1, (a.last - a.first + 7) / 8);
    for (int d = a.first; d <= a.last; d += every) {
      const double at = a.at(std::pow(10.0, d));
      if (horizontal) {
        out += fmt::format(
            "<path class='grid' d='M{0:.1f} {1}V{2}'/><text x='{0:.1f}' y='{3}' "
            "text-anchor='middle'>1e{4}</text>",
            at, top, height - bottom, height - bottom + 16, d);
      } else {
        out += fmt::format(
            "<path class='grid' d='M{1} {0:.1f}H{2}'/><text x='{3}' y='{4:.1f}' "
            "text-anchor='end'>1e{5}</text>",
            at, left, width - right, left - 6, at + 4, d);
      }
    }
  };
  ticks(x, true);
  ticks(y, false);
  out += fmt::format("<text x='{}' y='{}' text-anchor='middle'>{}</text>", (left + width - right) / 2,
                     height - 12, escaped(x_label));
  out += fmt::format("<text transform='translate(16 {}) rotate(-90)' text-anchor='middle'>{}</text>",
                     (top + height - bottom) / 2, escaped(y_label));
  for (std::size_t i = 0; i < series.size(); ++i) {
    const char* colour = colours[i % std::size(colours)];
    std::string line, marks;
    for (const auto& p : series[i].points) {
      if (!drawable(p)) continue;
      const double px = x.at(p.first), py = y.at(p.second);
      line += fmt::format("{}{:.1f} {:.1f}", line.empty() ? "M" : "L", px, py);
      marks += marker(i, px, py, colour);
    }
    const double ly = top + 10 + 18.0 * static_cast<double>(i);
    out += fmt::format("<path d='{}' fill='none' stroke='{}' stroke-width='1.5'{}/>{}", line, colour,
                       i % 2 == 1 ? " stroke-dasharray='5 3'" : "", marks);
    out += marker(i, width - right + 16, ly - 4, colour) +
           fmt::format("<text x='{}' y='{}'>{}</text>", width - right + 26, ly, escaped(series[i].name));
  }
  return out + "</svg>\n";
}

std::string standalone(const std::string& svg) {
  const std::string head = "<svg ";
  if (!svg.starts_with(head)) return svg;
  return "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 640 400' "
         "style='background:#fff;color:#222;font:12px sans-serif'><style>.grid{stroke:#222;"
         "opacity:.15}.title{font-size:14px;font-weight:600}text{fill:#222}</style>" +
         svg + "</svg>\n";
}

std::string study_page(const std::string& title, const std::string& command, const std::string& body) {
  return fmt::format(
      "<!doctype html><html lang='en'><meta charset='utf-8'><meta name='viewport' "
      "content='width=device-width'><title>{0}</title>"
      "<style>:root{{color-scheme:light dark}}body{{font:15px/1.45 system-ui,sans-serif;margin:2em "
      "auto;max-width:60em;padding:0 1em}}"
      "svg{{width:100%;max-width:46em;font-size:12px;fill:currentColor}}.title{{font-size:14px;font-weight:"
      "600}}"
      ".grid{{stroke:currentColor;opacity:.15}}.wide{{overflow-x:auto}}table{{border-collapse:collapse;font-variant-numeric:tabular-"
      "nums;margin:1em 0}}"
      "td,th{{padding:.15em .7em;border-bottom:1px solid "
      "#8885;text-align:right}}td:first-child,th:first-child{{text-align:left}}"
      "code{{font-size:13px}}</style><h1>{0}</h1><p><code>{1}</code></p>{2}</html>\n",
      escaped(title), escaped(command), body);
}

std::string html_table(const std::vector<std::vector<std::string>>& rows) {
  std::string out = "<div class='wide'><table>";
  for (std::size_t r = 0; r < rows.size(); ++r) {
    out += "<tr>";
    for (const std::string& cell : rows[r])
      out += fmt::format("<{0}>{1}</{0}>", r == 0 ? "th" : "td", escaped(cell));
    out += "</tr>\n";
  }
  return out + "</table></div>\n";
}

std::string markdown_table(const std::vector<std::vector<std::string>>& rows) {
  std::string out;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    out += fmt::format("| {} |\n", fmt::join(rows[r], " | "));
    if (r != 0) continue;
    for (std::size_t i = 0; i < rows[r].size(); ++i) out += "|---";
    out += "|\n";
  }
  return out;
}

std::string csv_table(const std::vector<std::vector<std::string>>& rows) {
  std::string out;
  for (const auto& row : rows) out += fmt::format("{}\n", fmt::join(row, ","));
  return out;
}

}  // namespace esmc::host
