#include "host_sim/commands/log.hpp"

#include <fmt/compile.h>

#include <algorithm>
#include <cstring>
#include <iterator>
#include <utility>

#include "host_sim/error.hpp"

namespace esmc::host {
namespace {
constexpr std::size_t report_rows = 2000;
constexpr std::size_t flush_bytes = 1U << 16U;
}  // namespace

Log::Log(const std::string& path, std::vector<std::string> columns, std::size_t rows)
    : columns_(std::move(columns)), stride_((rows + report_rows - 1) / report_rows) {
  if (stride_ == 0) stride_ = 1;
  if (path.empty()) return;
  file_ = std::fopen(path.c_str(), "wb");
  if (file_ == nullptr) throw InputError("", path + ": cannot be written");
  fmt::format_to(std::back_inserter(buffer_), "{}\n", fmt::join(columns_, ","));
}

Log::Log(Log&& other) noexcept { *this = std::move(other); }

Log& Log::operator=(Log&& other) noexcept {
  std::swap(file_, other.file_);
  std::swap(buffer_, other.buffer_);
  std::swap(columns_, other.columns_);
  std::swap(thinned_, other.thinned_);
  std::swap(stride_, other.stride_);
  std::swap(written_, other.written_);
  return *this;
}

Log::~Log() {
  if (file_ != nullptr) std::fclose(file_);
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
  if (written_ % stride_ == 0) thinned_.push_back({values, state});
  ++written_;
  if (buffer_.size() >= flush_bytes) {
    std::fwrite(buffer_.data(), 1, buffer_.size(), file_);
    buffer_.clear();
  }
}

void Log::close() {
  if (file_ == nullptr) return;
  const bool whole = std::fwrite(buffer_.data(), 1, buffer_.size(), file_) == buffer_.size();
  const bool closed = std::fclose(std::exchange(file_, nullptr)) == 0;
  if (!whole || !closed) throw RunError("the log could not be written completely (disk full?)");
}

}  // namespace esmc::host
