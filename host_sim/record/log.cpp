#include "host_sim/record/log.hpp"

#include <fmt/compile.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <iterator>
#include <utility>

#include "host_sim/error.hpp"

namespace esmc::host {
namespace {
constexpr std::size_t report_rows = 2000;
constexpr std::size_t flush_bytes = 1U << 16U;
static_assert(std::endian::native == std::endian::little, "log.npy holds doubles as they are in memory");
constexpr std::size_t state_bytes = 8;  // of the longest name, in log.npy
}  // namespace

Log::Log(const LogSink& to, std::vector<std::string> columns, std::size_t rows)
    : file_(to.file),
      options_(to.options),
      mcap_(to.mcap),
      columns_(std::move(columns)),
      stride_(std::max<std::size_t>(1, (rows + report_rows - 1) / report_rows)) {
  const auto is_torque = [](const std::string& c) { return c.starts_with("tau") && !c.ends_with("_cmd"); };
  torque_ = static_cast<std::size_t>(std::ranges::find_if(columns_, is_torque) - columns_.begin());
  motors_ = static_cast<std::size_t>(std::ranges::count_if(columns_, is_torque));
  if (mcap_ != nullptr) mcap_->columns(columns_);
  if (file_ == nullptr) return;
  spectra_.resize(motors_);
  if (options_.npy) {
    buffer_.append(npy_header());
  } else {
    fmt::format_to(std::back_inserter(buffer_), "{}\n", fmt::join(columns_, ","));
  }
}

/// NPY 1.0: a structured array of little-endian doubles, which numpy.load reads as it is. Of one size for any
/// number of rows.
std::string Log::npy_header() const {
  std::string names;
  for (const std::string& c : columns_)
    names +=
        c == "state" ? fmt::format("('state', 'S{}'), ", state_bytes) : fmt::format("('{}', '<f8'), ", c);
  const std::string rows = fmt::format("{}", written_);
  std::string text = fmt::format("{{'descr': [{}], 'fortran_order': False, 'shape': ({},), }}{:{}}", names,
                                 rows, "", 20 - rows.size());
  constexpr std::size_t before = 10, step = 64;  // magic, version, length; alignment of the data
  text.append(step - 1 - (before + text.size()) % step, ' ');
  text += '\n';
  const auto low = static_cast<char>(text.size() & 0xFFU), high = static_cast<char>(text.size() >> 8U);
  return std::string("\x93NUMPY\x01\x00", 8) + low + high + text;
}

void Log::keep(KeptLog* to) {
  kept_ = to;
  if (to == nullptr) return;
  *to = {columns_, {}, {}};
  if (columns_.back() == "state") to->columns.pop_back();
}

void Log::row(const std::vector<double>& values, const char* state) {
  if (kept_ != nullptr) {
    kept_->values.insert(kept_->values.end(), values.begin(), values.end());
    if (*state != '\0') kept_->states.push_back(state);
  }
  const bool due = ticks_++ % options_.every == 0;
  if (mcap_ != nullptr && due) mcap_->row(values, state);
  if (file_ == nullptr) return;
  if (due) {
    if (options_.npy) {
      add_binary(values, state);
    } else {
      add_text(values, state);
    }
    ++written_;
  }
  watch_torques(values, *state == '\0' || std::strcmp(state, "running") == 0);
  if ((ticks_ - 1) % stride_ == 0) {
    thinned_.push_back({values, state, changes_ > 0 ? change_ / static_cast<double>(changes_) : 0.0});
    change_ = 0.0;
    changes_ = 0;
  }
  if (buffer_.size() >= flush_bytes) {
    std::fwrite(buffer_.data(), 1, buffer_.size(), file_.get());
    buffer_.clear();
  }
}

void Log::add_text(const std::vector<double>& values, const char* state) {
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
}

void Log::add_binary(const std::vector<double>& values, const char* state) {
  const auto* const bytes = reinterpret_cast<const char*>(values.data());
  buffer_.append(bytes, bytes + values.size() * sizeof(double));
  if (*state == '\0') return;
  std::array<char, state_bytes> name{};
  std::copy_n(state, std::min(std::strlen(state), state_bytes), name.begin());
  buffer_.append(name.data(), name.data() + name.size());
}

/// Values that thinning would lose, and the tick time.
void Log::watch_torques(const std::vector<double>& values, bool running) {
  const auto now = std::chrono::steady_clock::now();
  const auto first = values.begin() + static_cast<std::ptrdiff_t>(torque_);
  if (ticks_ > 1) {
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
  bool whole = std::fwrite(buffer_.data(), 1, buffer_.size(), file_.get()) == buffer_.size();
  if (options_.npy) {  // now with the number of rows
    const std::string header = npy_header();
    whole = whole && std::fseek(file_.get(), 0, SEEK_SET) == 0 &&
            std::fwrite(header.data(), 1, header.size(), file_.get()) == header.size();
  }
  const bool closed = std::fclose(file_.release()) == 0;
  if (!whole || !closed) throw RunError("the log could not be written completely (disk full?)");
}

}  // namespace esmc::host
