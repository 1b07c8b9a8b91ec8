#include "host_sim/report/study_page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>

#include "host_sim/version.hpp"

namespace esmc::host {

using Document = nlohmann::ordered_json;

extern const std::string_view look_css;  // look.css, embedded by embed.cmake

namespace {

constexpr double figure_width = 640, figure_height = 400, left = 70, right = 170, top = 34, bottom = 50;
constexpr std::size_t most_marked = 60;  // points of a line that have markers; of a longer one eight have
// Okabe and Ito: distinct for every kind of colour vision, on white and on black.
constexpr const char* colours[] = {"#0072b2", "#d55e00", "#009e73", "#cc79a7",
                                   "#e69f00", "#56b4e9", "#999999", "#b8a800"};

std::string escaped(const std::string& s) {
  std::string out;
  for (const char c : s) {
    const char* entity = c == '<' ? "&lt;" : (c == '>' ? "&gt;" : (c == '&' ? "&amp;" : nullptr));
    entity != nullptr ? out.append(entity) : out.append(1, c);
  }
  return out;
}

/// Begin of a figure with its title; the caller adds "</svg>\n".
std::string svg(const std::string& title, double tall = figure_height) {
  return fmt::format(
      "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {0} {1}' role='img' aria-label='{2}'><text "
      "x='{3}' "
      "y='20' class='title'>{2}</text>",
      figure_width, tall, escaped(title), left);
}
/// `anchor`: start, middle or end.
std::string label(double x, double y, const char* anchor, const std::string& text) {
  return fmt::format("<text x='{:.1f}' y='{:.1f}' text-anchor='{}'>{}</text>", x, y, anchor, escaped(text));
}
std::string grid_line(double x, double y, char direction, double to) {
  return fmt::format("<path class='grid' d='M{:.1f} {:.1f}{}{}'/>", x, y, direction, to);
}
std::string decade(int d) { return fmt::format("1e{}", d); }

/// Values from `low` to `high` and a little beyond, along a line from `from` to `to`.
struct ChartAxis {
  Scale scale;
  double low, high, from, to;

  ChartAxis(Scale s, double first, double last, double at_first, double at_last)
      : scale(s), low(of(first)), high(of(last)), from(at_first), to(at_last) {
    const double margin = high > low ? 0.04 * (high - low) : std::max(1e-300, 0.1 * std::abs(high));
    low -= margin;
    high += margin;
  }
  [[nodiscard]] double at(double v) const { return from + (to - from) * (of(v) - low) / (high - low); }
  /// Calls mark(text, position) for at most nine round values.
  template <class Mark>
  void for_each_mark(Mark mark) const {
    if (scale == Scale::linear) return for_each_round(low, high, mark);
    if (high - low < 0.7) return for_each_round(std::pow(10.0, low), std::pow(10.0, high), mark);
    const int first = static_cast<int>(std::ceil(low)), last = static_cast<int>(std::floor(high));
    for (int d = first; d <= last; d += std::max(1, (last - first + 7) / 8))
      mark(decade(d), at(std::pow(10.0, d)));
    if (last > first) return;
    for (int d = first - 1; d <= last; ++d) {  // no two decades are in sight
      for (const double m : {2.0, 5.0}) {
        const double v = m * std::pow(10.0, d);
        if (of(v) > low && of(v) < high) mark(fmt::format("{:g}", v), at(v));
      }
    }
  }

 private:
  template <class Mark>
  void for_each_round(double first, double last, Mark mark) const {
    const double step = round_step((last - first) / 7.0);
    for (double k = std::ceil(first / step); k * step <= last; ++k)
      mark(fmt::format("{:.4g}", k * step + 0.0), at(k * step));  // + 0: no -0
  }
  [[nodiscard]] double of(double v) const { return scale == Scale::log ? std::log10(v) : v; }
  /// The next of 1, 2, 5 times a power of ten.
  static double round_step(double least) {
    const double power = std::pow(10.0, std::floor(std::log10(least)));
    for (const double m : {1.0, 2.0, 5.0}) {
      if (m * power >= least) return m * power;
    }
    return 10.0 * power;
  }
};

/// `kind` picks colour and shape, of which there are 14 without the colour; the class lets a page with a look
/// of its own choose another colour.
std::string marker(std::size_t kind, double x, double y) {
  constexpr const char* shapes[] = {"m-3 0a3 3 0 1 0 6 0a3 3 0 1 0 -6 0z",
                                    "m-3 -3h6v6h-6z",
                                    "m0 -4l4 7h-8z",
                                    "m0 -4l4 4l-4 4l-4 -4z",
                                    "m0 4l4 -7h-8z",
                                    "m4 0l-7 4v-8z",
                                    "m-4 0l7 4v-8z"};
  const std::size_t colour = kind % std::size(colours);
  return fmt::format("<path class='s{}' d='M{:.1f} {:.1f}{}' color='{}' {}/>", colour, x, y,
                     shapes[kind % std::size(shapes)], colours[colour],
                     kind / std::size(shapes) % 2 == 0
                         ? "fill='currentColor'"
                         : "fill='none' stroke='currentColor' stroke-width='1.5'");
}

bool drawable(double v, Scale scale) { return std::isfinite(v) && (scale == Scale::linear || v > 0.0); }

/// A value of a document as the cell of a table.
std::string cell_of(const Document& v) {
  if (v.is_string()) return v.get<std::string>();
  if (v.is_boolean()) return v.get<bool>() ? "yes" : "no";
  if (v.is_number_float())
    return std::isfinite(v.get<double>()) ? fmt::format("{:.4g}", v.get<double>()) : "";
  if (!v.is_structured()) return v.is_null() ? "" : v.dump();
  std::string out;
  for (const auto& [key, inner] : v.items()) {
    out += out.empty() ? "" : " ";
    out += v.is_object() && v.size() > 1 ? key + " " + cell_of(inner) : cell_of(inner);
  }
  return out;
}

bool of_objects(const Document& v) {
  return v.is_array() && !v.empty() &&
         std::ranges::all_of(v, [](const Document& one) { return one.is_object(); });
}

/// Panels of a document, in the order in which they are shown.
struct DocumentPanels {
  std::string tables;
  TextTable values{{"name", "value"}};
  std::string texts;

  void add(const std::string& name, const Document& v) {
    if (of_objects(v)) {
      tables += table_html(name, rows_of(v));
    } else if (v.is_object()) {
      for (auto [key, inner] : v.items()) {
        std::string words = key;
        std::ranges::replace(words, '_', ' ');
        add(name.empty() ? words : name + ", " + words, inner);
      }
    } else if (v.is_string() && v.get<std::string>().find('\n') != std::string::npos) {
      texts += fmt::format("<section class='panel'><h2>{}</h2><pre>{}</pre></section>\n", name,
                           escaped(v.get<std::string>()));
    } else if (!v.empty()) {
      values.push_back({name, cell_of(v)});
    }
  }
};

}  // namespace

std::string chart_svg(const std::string& title, const std::string& x_label, const std::string& y_label,
                      const std::vector<Series>& series, Scale x_scale, Scale y_scale) {
  const auto shown = [&](const std::pair<double, double>& p) {
    return drawable(p.first, x_scale) && drawable(p.second, y_scale);
  };
  double x0 = 1e300, x1 = -1e300, y0 = 1e300, y1 = -1e300;
  for (const Series& s : series) {
    for (const auto& p : s.points) {
      if (!shown(p)) continue;
      x0 = std::min(x0, p.first);
      x1 = std::max(x1, p.first);
      y0 = std::min(y0, p.second);
      y1 = std::max(y1, p.second);
    }
  }
  if (x0 > x1) return "";
  const double end = figure_width - right, base = figure_height - bottom;
  const ChartAxis x(x_scale, x0, x1, left, end), y(y_scale, y0, y1, base, top);
  std::string out = svg(title);
  x.for_each_mark([&](const std::string& text, double at) {
    out += grid_line(at, top, 'V', base) + label(at, base + 16, "middle", text);
  });
  y.for_each_mark([&](const std::string& text, double at) {
    out += grid_line(left, at, 'H', end) + label(left - 6, at + 4, "end", text);
  });
  out += label((left + end) / 2, figure_height - 12, "middle", x_label);
  out += fmt::format("<text transform='translate(16 {}) rotate(-90)' text-anchor='middle'>{}</text>",
                     (top + base) / 2, escaped(y_label));
  for (std::size_t i = 0; i < series.size(); ++i) {
    std::string line, marks;
    const std::size_t points = series[i].points.size();
    const std::size_t marked = series[i].line && points > most_marked ? points / 8 : 1;
    for (std::size_t n = 0; n < points; ++n) {
      const auto& p = series[i].points[n];
      if (!shown(p)) continue;
      const double px = x.at(p.first), py = y.at(p.second);
      if (series[i].line) line += fmt::format("{}{:.1f} {:.1f}", line.empty() ? "M" : "L", px, py);
      if (n % marked == marked / 2) marks += marker(i, px, py);
    }
    const double ly = top + 10 + 18.0 * static_cast<double>(i);
    const std::size_t kind = i % std::size(colours);
    out += fmt::format(
        "<path class='s{}' d='{}' fill='none' color='{}' stroke='currentColor' stroke-width='1.5'{}/>{}",
        kind, line, colours[kind], i % 2 == 1 ? " stroke-dasharray='5 3'" : "", marks);
    out += marker(i, end + 16, ly - 4) + label(end + 26, ly, "start", series[i].name);
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
  if (bars.empty() || !(bars.front().to > bars.front().from)) return "";
  const double lo = bars.front().from, hi = bars.back().to,
               most = std::ranges::max(bars, {}, &Bar::count).count;
  constexpr double end = figure_width - 30, base = figure_height - bottom;
  const int decades = std::max(1, static_cast<int>(std::ceil(std::log10(most + 0.5))));
  const auto x = [&](double v) { return left + (v - lo) / (hi - lo) * (end - left); };
  const auto y = [&](double count) {
    return base - (std::log10(count) + 0.3) / (decades + 0.3) * (base - top);
  };
  std::string out = svg(title);
  for (int d = 0; d <= decades; ++d) {
    const double at = y(std::pow(10.0, d));
    out += grid_line(left, at, 'H', end) + label(left - 6, at + 4, "end", decade(d));
  }
  double step = bars.front().to - bars.front().from;  // marks at edges of bars
  while ((hi - lo) / step > 8.5) step *= 2.0;
  for (double v = lo; v <= hi + 1e-9 * step; v += step)
    out += label(x(v), base + 16, "middle", fmt::format("{:.4g}", v));
  out += label((left + end) / 2, figure_height - 12, "middle", x_label);
  for (const Bar& b : bars) {
    if (!(b.count > 0.0)) continue;
    out += fmt::format(
        "<rect class='s0' fill='currentColor' color='{}' x='{:.1f}' y='{:.1f}' width='{:.1f}' "
        "height='{:.1f}'><title>{:.4g} to {:.4g}: {:.0f}</title></rect>",
        colours[0], x(b.from), y(b.count), std::max(1.0, x(b.to) - x(b.from) - 0.5), base - y(b.count),
        b.from, b.to, b.count);
  }
  return out + "</svg>\n";
}

std::string histogram_svg(const std::string& title, const std::string& x_label,
                          const std::vector<double>& sorted) {
  constexpr std::size_t bins = 60;
  constexpr double tall = 200, end = figure_width - 20, base = tall - 44, bar = (end - left) / bins;
  const double low = sorted.front(), span = sorted.back() - low;
  std::array<std::size_t, bins> count{};
  for (const double v : sorted)
    ++count[std::min(bins - 1, static_cast<std::size_t>((v - low) / span * bins))];
  const auto most = static_cast<double>(*std::max_element(count.begin(), count.end()));
  std::string out = svg(title, tall);
  for (std::size_t i = 0; i < bins; ++i) {
    const double h = (base - top) * static_cast<double>(count[i]) / most;
    out += fmt::format("<rect x='{:.1f}' y='{:.1f}' width='{:.1f}' height='{:.1f}' fill='{}'/>",
                       left + bar * static_cast<double>(i), base - h, bar - 1, h, colours[0]);
  }
  out += grid_line(left, base, 'H', end) + label(left - 6, top + 10, "end", fmt::format("{:g}", most));
  out += label(left, base + 16, "start", fmt::format("{:.3g}", low)) +
         label(end, base + 16, "end", fmt::format("{:.3g}", sorted.back()));
  return out + label((left + end) / 2, tall - 10, "middle", x_label) + "</svg>\n";
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

std::string table_html(const std::string& title, const TextTable& rows) {
  std::string out =
      fmt::format("<section class='panel'><h2>{}</h2><div class='wide'><table>", escaped(title));
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
  return out + "</table></div>\n</section>\n";
}

TextTable rows_of(const Document& list) {
  TextTable rows;
  for (const Document& object : list) {
    const bool first = rows.empty();
    if (first) rows.emplace_back();
    std::vector<std::string> row;
    for (const auto& [key, value] : object.items()) {
      const bool one = value.is_object() && value.size() == 1;
      if (first) rows.front().push_back(one ? key + ": " + value.items().begin().key() : key);
      row.push_back(cell_of(value));
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

std::string document_html(const Document& document) {
  DocumentPanels p;
  p.add("", document);
  return p.tables + table_html("Values", p.values) + p.texts;
}

std::string markdown_table(const TextTable& rows) {
  std::string out;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    out += fmt::format("| {} |\n", fmt::join(rows[r], " | "));
    if (r != 0) continue;
    for (std::size_t i = 0; i < rows[r].size(); ++i) out += "|---";
    out += "|\n";
  }
  return out;
}

std::string csv_table(const TextTable& rows) {
  std::string out;
  for (const auto& row : rows) out += fmt::format("{}\n", fmt::join(row, ","));
  return out;
}

}  // namespace esmc::host
