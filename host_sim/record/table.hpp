#pragma once
/// Columns of numbers as a run has left them (log.csv), or as a laboratory has measured them.

#include <cstddef>
#include <string>
#include <vector>

namespace esmc::host {

/// The columns that were asked for, in that order, each with one value per row.
struct RecordedTable {
  std::string file;
  std::vector<std::string> header;           ///< of all columns of the file
  std::vector<std::vector<double>> columns;  ///< finite
  std::vector<std::string> words;            ///< of one column more, where there is one of that name
  [[nodiscard]] std::size_t rows() const { return columns.empty() ? 0 : columns.front().size(); }
  /// FILE:LINE of a row.
  [[nodiscard]] std::string where(std::size_t row) const { return file + ":" + std::to_string(row + 2); }
};

/// Reads the columns `names` of a CSV with a header. Only they need be numbers: finite, in every row. Every
/// row must have as many fields as the header, and the last line its end: a log that was torn is refused.
/// `hint` follows "there is no column X"; `word` names a column of words, which need not be there. Throws
/// InputError that names file and line.
RecordedTable read_table(const std::string& file, const std::vector<std::string>& names,
                         const std::string& hint, const std::string& word = "");

/// Throws InputError unless the values ascend strictly: `column` of the table, a time.
void require_ascending(const RecordedTable& table, std::size_t column);

/// Throws InputError at the first row that is not a whole number of ticks after the first one, as many as
/// rows: `column` of the table, a time; `tick`: s.
void require_every_tick(const RecordedTable& table, std::size_t column, double tick);

/// Throws InputError at the first row whose distance from the one before is not that of all, but for
/// rounding; `hint`: what follows then.
void require_even(const RecordedTable& table, std::size_t column, const std::string& hint);

}  // namespace esmc::host
