#pragma once
/// Columns of numbers from log.csv or a measurement.

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace esmc::host {

/// The requested columns, in that order, each with one value per row.
struct RecordedTable {
  std::string file;
  std::vector<std::string> header;           ///< of all columns of the file
  std::vector<std::vector<double>> columns;  ///< finite
  std::vector<std::string> words;            ///< of the column `word`, if there is one
  [[nodiscard]] std::size_t rows() const { return columns.empty() ? 0 : columns.front().size(); }
  /// FILE:LINE of a row.
  [[nodiscard]] std::string where(std::size_t row) const { return file + ":" + std::to_string(row + 2); }
};

/// What is between the commas of a line.
std::vector<std::string_view> fields_of(std::string_view line);

/// Throws InputError unless `file` is a regular file: a pipe would wait, a device would never end.
void require_regular_file(const std::string& file);

/// Reads the columns `names` of a CSV with a header; their values must be finite. Every row must have as many
/// fields as the header, and the last line must end with a newline. `hint` follows "there is no column X";
/// `word` names an optional column of words. Throws InputError that names file and line.
RecordedTable read_table(const std::string& file, const std::vector<std::string>& names,
                         const std::string& hint, const std::string& word = "");

/// Throws InputError unless the values ascend strictly: `column` of the table, a time.
void require_ascending(const RecordedTable& table, std::size_t column);

/// Throws InputError unless row i is i ticks after the first one: `column` of the table, a time; `tick`: s.
void require_every_tick(const RecordedTable& table, std::size_t column, double tick);

/// Throws InputError unless the rows are equidistant, but for rounding; `hint` ends the message.
void require_even(const RecordedTable& table, std::size_t column, const std::string& hint);

}  // namespace esmc::host
