#include "host_sim/record/run_mcap.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>

#include "host_sim/error.hpp"

namespace esmc::host {
namespace {

/// A JSON Schema of an object with these numbers and texts.
std::string schema_of(const std::vector<std::string>& numbers, const std::vector<std::string>& texts) {
  std::string properties = R"("t":{"type":"number","description":"s"})";
  for (const std::string& n : numbers) properties += fmt::format(R"(,"{}":{{"type":"number"}})", n);
  for (const std::string& n : texts) properties += fmt::format(R"(,"{}":{{"type":"string"}})", n);
  return fmt::format(R"({{"type":"object","properties":{{{}}}}})", properties);
}

const char* topic_of(const std::string& column) {
  if (column.starts_with("s_")) return "sliding";
  if (column.starts_with("tau")) return "torques";
  if (column.starts_with("theta")) return "joints";
  return column.starts_with("x") || column.starts_with("y") ? "effector" : "controller";
}

void add_number(std::string& to, const std::string& name, double v) {
  if (std::isfinite(v)) {
    fmt::format_to(std::back_inserter(to), ",\"{}\":{}", name,
                   v);  // shortest text that reads back to the same double
  } else {
    fmt::format_to(std::back_inserter(to), ",\"{}\":null", name);
  }
}

}  // namespace

RunMcap::RunMcap(const std::string& file) : file_(file), part_(fmt::format("{}.part-{}", file, ::getpid())) {
  namespace fs = std::filesystem;
  std::error_code error;
  if (fs::exists(fs::symlink_status(file_, error)) && !fs::is_regular_file(fs::symlink_status(file_, error)))
    refuse("--mcap {}: exists and is not a regular file", file_);
  std::FILE* const f = std::fopen(part_.c_str(), "wbx");
  if (f == nullptr) refuse("--mcap {}: cannot be written", file_);
  writer_.emplace(f);
  can_ = writer_->channel("/can", "esmc.Can", schema_of({"id", "size"}, {"data", "kind"}));
}

RunMcap::~RunMcap() {
  std::error_code ignored;
  if (writer_) std::filesystem::remove(part_, ignored);
}

void RunMcap::columns(const std::vector<std::string>& names) {
  names_ = names;
  with_state_ = names_.back() == "state";
  for (const std::string topic : {"effector", "joints", "torques", "sliding", "controller"}) {
    Topic t;
    std::vector<std::string> of_topic;
    for (std::size_t i = 1; i < names_.size() - (with_state_ ? 1 : 0); ++i) {
      if (topic_of(names_[i]) != topic) continue;
      t.columns.push_back(i);
      of_topic.push_back(names_[i]);
    }
    const bool state = with_state_ && topic == "controller";
    if (t.columns.empty() && !state) continue;
    t.channel = writer_->channel(
        "/" + topic, "esmc." + topic,
        schema_of(of_topic, state ? std::vector<std::string>{"state"} : std::vector<std::string>{}));
    if (topic == "controller") controller_ = t.channel;
    topics_.push_back(std::move(t));
  }
}

void RunMcap::row(const std::vector<double>& values, const char* state) {
  if (!begun_) begin_ns_ = now_ns_;
  begun_ = true;
  const auto t = static_cast<std::uint64_t>(std::llround(values[0] * 1e9));
  now_ns_ = std::max(now_ns_, begin_ns_ + t);
  for (const Topic& topic : topics_) {
    text_ = fmt::format("{{\"t\":{}", values[0]);
    for (const std::size_t i : topic.columns) add_number(text_, names_[i], values[i]);
    if (with_state_ && topic.channel == controller_) text_ += fmt::format(R"(,"state":"{}")", state);
    text_ += '}';
    writer_->message(topic.channel, begin_ns_ + t, text_);
  }
}

void RunMcap::frame(std::int64_t time_us, const hal::CanFrame& f) {
  now_ns_ = std::max(now_ns_, static_cast<std::uint64_t>(time_us) * 1000U);
  const char* const kind = f.remote ? "remote" : f.fd ? "fd" : "data";
  text_ = fmt::format(R"({{"t":{},"id":{},"size":{},"kind":"{}{}","data":")",
                      static_cast<double>(now_ns_) * 1e-9, f.id, f.size, f.extended ? "extended " : "", kind);
  if (!f.remote) {
    for (const std::uint8_t byte : f.payload()) fmt::format_to(std::back_inserter(text_), "{:02X}", byte);
  }
  text_ += "\"}";
  writer_->message(can_, now_ns_, text_);
}

void RunMcap::commit() {
  writer_->close();
  std::error_code error;
  std::filesystem::rename(part_, file_, error);
  if (error) throw RunError("--mcap " + file_ + ": cannot be written: " + error.message());
  writer_.reset();
}

}  // namespace esmc::host
