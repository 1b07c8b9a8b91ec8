#include "host_sim/report/study_page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>

#include "host_sim/version.hpp"

namespace esmc::host {

extern const std::string_view look_css;  // look.css, embedded by embed.cmake

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

/// `kind` picks shape and colour; the class lets a page with a look of its own choose another colour.
std::string marker(std::size_t kind, double x, double y) {
  kind %= std::size(colours);
  switch (kind % 3) {
    case 0:
      return fmt::format(
          "<circle class='s{3}' cx='{0:.1f}' cy='{1:.1f}' r='3' color='{2}' fill='currentColor'/>", x, y,
          colours[kind], kind);
    case 1:
      return fmt::format(
          "<rect class='s{3}' x='{0:.1f}' y='{1:.1f}' width='6' height='6' color='{2}' fill='currentColor'/>",
          x - 3, y - 3, colours[kind], kind);
    default:
      return fmt::format("<path class='s{3}' d='M{0:.1f} {1:.1f}l4 7h-8z' color='{2}' fill='currentColor'/>",
                         x, y - 4, colours[kind], kind);
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
    std::string line, marks;
    for (const auto& p : series[i].points) {
      if (!drawable(p)) continue;
      const double px = x.at(p.first), py = y.at(p.second);
      if (series[i].line) line += fmt::format("{}{:.1f} {:.1f}", line.empty() ? "M" : "L", px, py);
      marks += marker(i, px, py);
    }
    const double ly = top + 10 + 18.0 * static_cast<double>(i);
    const std::size_t kind = i % std::size(colours);
    out += fmt::format(
        "<path class='s{}' d='{}' fill='none' color='{}' stroke='currentColor' stroke-width='1.5'{}/>{}",
        kind, line, colours[kind], i % 2 == 1 ? " stroke-dasharray='5 3'" : "", marks);
    out += marker(i, width - right + 16, ly - 4) +
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

std::string bar_svg(const std::string& title, const std::string& x_label, const std::vector<Bar>& bars) {
  double lo = std::numeric_limits<double>::infinity(), hi = 0.0, most = 0.0;
  for (const Bar& b : bars) {
    lo = std::min(lo, b.from);
    hi = std::max(hi, b.to);
    most = std::max(most, b.count);
  }
  if (!(hi > lo) || !(most > 0.0) || !(bars.front().to > bars.front().from)) return "";
  constexpr double end = width - 30, base = height - bottom;
  const int decades = std::max(1, static_cast<int>(std::ceil(std::log10(most + 0.5))));
  const auto x = [&](double v) { return left + (v - lo) / (hi - lo) * (end - left); };
  const auto y = [&](double count) {
    return base - (std::log10(count) + 0.3) / (decades + 0.3) * (base - top);
  };
  std::string out = fmt::format(
      "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {} {}' role='img' aria-label='{}'><text x='{}' "
      "y='20' "
      "class='title'>{}</text>",
      width, height, escaped(title), left, escaped(title));
  for (int d = 0; d <= decades; ++d) {
    const double at = y(std::pow(10.0, d));
    out += fmt::format(
        "<path class='grid' d='M{} {:.1f}H{}'/><text x='{}' y='{:.1f}' text-anchor='end'>1e{}</text>", left,
        at, end, left - 6, at + 4, d);
  }
  double step = bars.front().to - bars.front().from;  // marks at edges of bars
  while ((hi - lo) / step > 8.5) step *= 2.0;
  for (double v = lo; v <= hi + 1e-9 * step; v += step)
    out += fmt::format("<text x='{:.1f}' y='{}' text-anchor='middle'>{:.4g}</text>", x(v), base + 16, v);
  out += fmt::format("<text x='{}' y='{}' text-anchor='middle'>{}</text>", (left + end) / 2, height - 12,
                     escaped(x_label));
  for (const Bar& b : bars) {
    if (!(b.count > 0.0)) continue;
    out += fmt::format(
        "<rect class='s0' fill='currentColor' color='{}' x='{:.1f}' y='{:.1f}' width='{:.1f}' "
        "height='{:.1f}'><title>{:.4g} to "
        "{:.4g}: {:.0f}</title></rect>",
        colours[0], x(b.from), y(b.count), std::max(1.0, x(b.to) - x(b.from) - 0.5), base - y(b.count),
        b.from, b.to, b.count);
  }
  return out + "</svg>\n";
}

std::string study_page(const std::string& title, const std::string& command, const std::string& body,
                       const StudyVerdict& verdict) {
  std::string out = fmt::format(
      "<!doctype html><html lang='en'><head><meta charset='utf-8'><meta name='viewport' "
      "content='width=device-width, initial-scale=1'><meta http-equiv='Content-Security-Policy' "
      "content=\"default-src 'none'; style-src "
      "'unsafe-inline'\"><title>{0}</title><style>\n{1}</style></head>"
      "<body class='study'><header><h1>{0}</h1><span class='mono muted'>esmc {2}</span></header>\n",
      escaped(title), look_css, version);
  if (!verdict.headline.empty()) {
    const char* levels[] = {"ok", "warn", "bad"};
    const char* marks[] = {"✓", "!", "✕"};
    const char* words[] = {"OK", "CHECK", "FAILED"};
    const auto level = static_cast<std::size_t>(verdict.level);
    out += fmt::format(
        "<section class='panel verdict' data-level='{}' aria-label='Verdict'><span class='symbol' "
        "aria-hidden='true'>{}</span><div><p class='headline'><b>{}</b> {}</p><p class='detail "
        "muted'>{}</p></div>",
        levels[level], marks[level], words[level], escaped(verdict.headline), escaped(verdict.detail));
    if (!verdict.tiles.empty()) {
      out += "<dl class='tiles'>";
      for (const auto& [name, value, note] : verdict.tiles) {
        out += fmt::format("<div><dt class='note'>{}</dt><dd>{}</dd><dd class='note'>{}</dd></div>",
                           escaped(name), escaped(value), escaped(note));
      }
      out += "</dl>";
    }
    out += "</section>\n";
  }
  return out +
         fmt::format(
             "<section class='panel'><h2>Repeat this study</h2><pre>{}</pre></section>\n{}</body></html>\n",
             escaped(command), body);
}

std::string figures_html(const std::vector<std::string>& drawings) {
  std::string out = "<section class='panel figures'>";
  for (const std::string& drawing : drawings) {
    if (!drawing.empty()) out += "<figure>" + drawing + "</figure>";
  }
  return out + "</section>\n";
}

std::string table_html(const std::string& title, const std::vector<std::vector<std::string>>& rows) {
  return fmt::format("<section class='panel'><h2>{}</h2>{}</section>\n", escaped(title), html_table(rows));
}

std::string html_table(const std::vector<std::vector<std::string>>& rows) {
  std::string out = "<div class='wide'><table>";
  const auto is_number = [](const std::string& s) {
    return s.find_first_not_of("0123456789.+-e ") == std::string::npos;
  };
  const auto of_numbers = [&](std::size_t column) {
    return std::all_of(rows.begin() + (rows.empty() ? 0 : 1), rows.end(),
                       [&](const auto& row) { return column >= row.size() || is_number(row[column]); });
  };
  for (std::size_t r = 0; r < rows.size(); ++r) {
    out += "<tr>";
    for (std::size_t c = 0; c < rows[r].size(); ++c) {
      out += fmt::format("<{0}{1}>{2}</{0}>", r == 0 ? "th" : "td", of_numbers(c) ? " class='number'" : "",
                         escaped(rows[r][c]));
    }
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
