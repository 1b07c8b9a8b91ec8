#pragma once
/// Pages of studies, in the look of a run's report, and their figures as SVG.

#include <array>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

namespace esmc::host {

/// Rows of text; the first row is the head.
using TextTable = std::vector<std::vector<std::string>>;

struct Series {
  std::string name;
  std::vector<std::pair<double, double>> points;  ///< finite, on a logarithmic axis > 0; others are left out
  bool line = true;                               ///< from point to point
};

enum class Scale { log, linear };
/// A figure (SVG) with a legend. Lines differ in colour and, where they have few points, in marker. Empty
/// where there is nothing to show.
std::string chart_svg(const std::string& title, const std::string& x_label, const std::string& y_label,
                      const std::vector<Series>& series, Scale x_scale = Scale::log,
                      Scale y_scale = Scale::log);

/// Turns a figure into the text of an SVG file of its own, on white.
std::string standalone(const std::string& svg);

struct Bar {
  double from = 0.0, to = 0.0, count = 0.0;
};
/// Counts per interval, ascending; heights are logarithms, so that one in a million is seen. Empty where
/// there is nothing to show.
std::string bar_svg(const std::string& title, const std::string& x_label, const std::vector<Bar>& bars);

/// A histogram (SVG) of numbers. `sorted`: finite, ascending, not all equal; it is not checked.
std::string histogram_svg(const std::string& title, const std::string& x_label,
                          const std::vector<double>& sorted);

/// Result of a study in a line; without a headline nothing is shown.
struct StudyVerdict {
  enum class Level { ok, warn, bad } level = Level::ok;
  std::string headline, detail;
  std::vector<std::array<std::string, 3>> tiles;  ///< name, value, note
};

/// A page around panels (below) that needs nothing but a browser. Texts are escaped; `body` is markup.
std::string study_page(const std::string& title, const std::string& command, const std::string& body,
                       const StudyVerdict& verdict = {});
/// Panels of a page: figures side by side; a table under its title.
std::string figures_html(const std::vector<std::string>& drawings);
std::string table_html(const std::string& title, const TextTable& rows);

/// A list of objects with the same keys as a table: lists and objects become one cell.
TextTable rows_of(const nlohmann::ordered_json& list);
/// Panels for a whole document (an object): a table of each list of objects, one of all other values, and
/// texts of several lines.
std::string document_html(const nlohmann::ordered_json& document);

/// Rows as Markdown and as CSV. Cells are not escaped: no | or line end, no comma in them.
std::string markdown_table(const TextTable& rows);
std::string csv_table(const TextTable& rows);

}  // namespace esmc::host
