#include "host_sim/record/log.hpp"

#include <fmt/compile.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <iterator>
#include <utility>

#include "host_sim/error.hpp"

namespace esmc::host {
namespace {
constexpr std::size_t report_rows = 2000;
constexpr std::size_t flush_bytes = 1U << 16U;
}  // namespace

Log::Log(std::FILE* file, std::vector<std::string> columns, std::size_t rows)
    : file_(file),
      columns_(std::move(columns)),
      stride_(std::max<std::size_t>(1, (rows + report_rows - 1) / report_rows)) {
  const auto is_torque = [](const std::string& c) { return c.starts_with("tau") && !c.ends_with("_cmd"); };
  torque_ = static_cast<std::size_t>(std::ranges::find_if(columns_, is_torque) - columns_.begin());
  motors_ = static_cast<std::size_t>(std::ranges::count_if(columns_, is_torque));
  if (file_ == nullptr) return;
  spectra_.resize(motors_);
  fmt::format_to(std::back_inserter(buffer_), "{}\n", fmt::join(columns_, ","));
}

void Log::row(const std::vector<double>& values, const char* state) {
  constexpr std::size_t longest = 32;  // of a double and a comma
  const std::size_t used = buffer_.size(), most = values.size() * longest + std::strlen(state) + 2;
  buffer_.resize(used + most);
  char* at = buffer_.data() + used;
  for (const double v : values) {
    at = fmt::format_to(at, FMT_COMPILE("{}"), v);  // shortest text that reads back to the same double
    *at++ = ',';
  }
  if (*state != '\0') {
    at = std::copy_n(state, std::strlen(state), at);
  } else {
    --at;
  }
  *at++ = '\n';
  buffer_.resize(static_cast<std::size_t>(at - buffer_.data()));
  watch_torques(values, *state == '\0' || std::strcmp(state, "running") == 0);
  if (written_ % stride_ == 0) {
    thinned_.push_back({values, state, changes_ > 0 ? change_ / static_cast<double>(changes_) : 0.0});
    change_ = 0.0;
    changes_ = 0;
  }
  ++written_;
  if (buffer_.size() >= flush_bytes) {
    std::fwrite(buffer_.data(), 1, buffer_.size(), file_.get());
    buffer_.clear();
  }
}

/// Values that thinning would lose, and the tick time.
void Log::watch_torques(const std::vector<double>& values, bool running) {
  const auto now = std::chrono::steady_clock::now();
  const auto first = values.begin() + static_cast<std::ptrdiff_t>(torque_);
  if (written_ > 0) {
    tick_time_.add(1e-9 * static_cast<double>(std::chrono::nanoseconds(now - last_row_).count()));
    for (std::size_t i = 0; i < motors_; ++i) change_ += std::abs(values[torque_ + i] - last_torque_[i]);
    changes_ += motors_;
  }
  last_row_ = now;
  for (std::size_t i = 0; i < motors_ && running; ++i) spectra_[i].add(values[torque_ + i]);
  last_torque_.assign(first, first + static_cast<std::ptrdiff_t>(motors_));
}

void Log::close() {
  if (file_ == nullptr) return;
  const bool whole = std::fwrite(buffer_.data(), 1, buffer_.size(), file_.get()) == buffer_.size();
  const bool closed = std::fclose(file_.release()) == 0;
  if (!whole || !closed) throw RunError("the log could not be written completely (disk full?)");
}

}  // namespace esmc::host
