#pragma once
/// Points that an operator has taught, by name, in a TOML file that people may edit.

#include <array>
#include <map>
#include <string>

#include "firmware/link/codec.hpp"

namespace esmc::host {

class Points {
 public:
  using Point = std::array<double, 2>;  ///< of the space: m, or base joints in rad

  /// Reads `file`; one that does not exist has no points. Throws InputError for another space, an entry that
  /// is no point, a bad name.
  Points(std::string file, link::Space space);

  /// Keeps the point in the file, in place of an earlier one of this name. `name`: 1 to 32 letters, digits,
  /// "_" and "-", beginning with a letter. Throws InputError.
  void teach(const std::string& name, const Point& at);
  /// Throws InputError naming the points that there are.
  [[nodiscard]] const Point& at(const std::string& name) const;
  [[nodiscard]] const std::map<std::string, Point>& all() const { return points_; }
  [[nodiscard]] const std::string& file() const { return file_; }

 private:
  std::string file_;
  link::Space space_;
  std::map<std::string, Point> points_;
};

}  // namespace esmc::host
