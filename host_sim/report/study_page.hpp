#pragma once
/// Log-log plots as SVG, for the pages of studies.

#include <string>
#include <utility>
#include <vector>

namespace esmc::host {

struct Series {
  std::string name;
  std::vector<std::pair<double, double>> points;  ///< > 0; others are left out
};

/// A figure with its legend. Lines differ in colour and marker.
std::string log_log_svg(const std::string& title, const std::string& x_label, const std::string& y_label,
                        const std::vector<Series>& series);

/// A figure as a file of its own, on white.
std::string standalone(const std::string& svg);

/// A page around figures and tables that needs nothing but a browser.
std::string study_page(const std::string& title, const std::string& command, const std::string& body);

/// Rows of text as an HTML table; the first row is its head.
std::string html_table(const std::vector<std::vector<std::string>>& rows);
/// The same as Markdown and as CSV.
std::string markdown_table(const std::vector<std::vector<std::string>>& rows);
std::string csv_table(const std::vector<std::vector<std::string>>& rows);

}  // namespace esmc::host
