#include "host_sim/scene/key.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

namespace esmc::host {
namespace {

/// Edit distance, where a swap of two neighbours counts once.
std::size_t distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> before(b.size() + 1), now(b.size() + 1), next(b.size() + 1);
  std::iota(now.begin(), now.end(), 0U);
  for (std::size_t i = 1; i <= a.size(); ++i) {
    next[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      next[j] = std::min({now[j] + 1, next[j - 1] + 1, now[j - 1] + (a[i - 1] == b[j - 1] ? 0U : 1U)});
      const bool swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
      if (swapped) next[j] = std::min(next[j], before[j - 2] + 1);
    }
    before = now;
    now = next;
  }
  return now[b.size()];
}

}  // namespace

std::string nearest(std::string_view word, const std::vector<std::string>& known) {
  const std::string* best = nullptr;
  std::size_t least = 3;
  for (const std::string& k : known) {
    const std::size_t d = distance(word, k);
    if (d < least && d < k.size()) {
      least = d;
      best = &k;
    }
  }
  return best != nullptr ? *best : std::string();
}

const Key& find_key(std::string_view path, std::span<const Key> among) {
  for (const Key& k : among) {
    if (k.path == path) return k;
  }
  throw std::logic_error("no entry in the key table: " + std::string(path));
}

std::string allowed(const Key& k) {
  std::string out;
  if (!k.choices.empty()) {
    out = fmt::format("{}one of: {}", k.kind == "strings" ? "array of strings, each " : "", k.choices);
    if (k.kind == "string or table") out += ", or a table";
  } else {
    out = k.kind;
    if (std::isfinite(k.low)) {
      out += k.low_open ? fmt::format(" > {} and <= {}", k.low, k.high)
                        : fmt::format(" from {} to {}", k.low, k.high);
    }
  }
  if (!k.unit.empty()) out += fmt::format(", {}", k.unit);
  return out;
}

std::string wanted(const Key& k) {
  std::string out = allowed(k);
  if (!k.choices.empty()) return out;
  if (k.kind.find("{position, angle}") != std::string_view::npos) {
    // The bounds hold for each of the two values.
    return "a number, or a table {position, angle} of numbers," + out.substr(k.kind.size()) +
           (k.kind.ends_with("\"robust\"") ? "; or \"robust\"" : "");
  }
  const bool plural = k.kind.ends_with('s') && k.kind.find(" or ") == std::string_view::npos;
  return plural ? out : (k.kind.starts_with("integer") ? "an " : "a ") + out;
}

std::string keys_markdown(std::span<const Key> of) {
  std::string out = "| key | allowed | default | meaning |\n|---|---|---|---|\n";
  for (const Key& k : of) {
    std::string range = allowed(k), fallback(k.fallback);
    for (std::size_t at = 0; (at = range.find(" | ", at)) != std::string::npos;) range.erase(at, 1)[at] = ',';
    if (fallback.empty()) fallback = "required";
    if (fallback == "-") fallback = "optional";
    out += fmt::format("| `{}` | {} | {} | {} |\n", k.path, range, fallback, k.meaning);
  }
  return out;
}

}  // namespace esmc::host
