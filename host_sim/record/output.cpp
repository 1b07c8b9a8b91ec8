#include "host_sim/record/output.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <system_error>

#include "host_sim/error.hpp"
#include "host_sim/json_text.hpp"
#include "host_sim/record/comparison.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

namespace fs = std::filesystem;

namespace {

/// Names of all files that a run may leave.
constexpr const char* output_names[] = {
    "scene.toml",      "summary.json", "log.csv",      "log.npy",           "frames.log",
    "frames.csv",      "report.html",  "check.csv",    reference_copy,      model_copy,
    endpoints_copy,    "sweep.toml",   "cases.csv",    "timing.json",       "timing.csv",
    "comparison.json", "check.json",   "design.json",  "calibration.json",  "identification.json",
    "margins.json",    "plan.json",    "path.csv",     "capture.csv",       "campaign.json",
    "campaign.md",     "episode.json", "episode.txt",  "accuracy.json",     "accuracy.md",
    "effects.csv",     "orders.csv",   "tracking.csv", "work_precision.csv"};

constexpr const char* partial_prefix = ".partial-";

/// What an unfinished sweep leaves.
bool unfinished(const std::string& name) { return name == "sweep.journal"; }

/// Whether this is the folder of a process that was killed; not of a living one, and not one interrupted
/// while files were moved, which may hold the former files.
bool abandoned(const fs::path& p) {
  const std::string name = p.filename();
  if (!name.starts_with(partial_prefix)) return false;
  const std::string pid = name.substr(std::string(partial_prefix).size());
  if (pid.empty() || pid.size() > 9 ||
      !std::all_of(pid.begin(), pid.end(), [](char c) { return c >= '0' && c <= '9'; }))
    return false;
  const bool dead =
      ::kill(static_cast<pid_t>(std::strtol(pid.c_str(), nullptr, 10)), 0) != 0 && errno == ESRCH;
  std::error_code error;
  return dead && fs::is_directory(fs::symlink_status(p, error)) && !fs::exists(p / "former", error);
}

/// Of the OutputDirectory that this process fills, for a signal handler.
std::atomic<const std::vector<std::string>*> to_remove{nullptr};
void remove_unfinished() {
  const std::vector<std::string>* const paths = to_remove.exchange(nullptr);
  if (paths == nullptr) return;
  for (const std::string& p : *paths) {
    if (::unlink(p.c_str()) != 0) (void)::rmdir(p.c_str());  // a folder with files of others stays
  }
}

/// While it exists, no other process has one of this directory.
class DirectoryLock {
 public:
  explicit DirectoryLock(const fs::path& directory)
      : fd_(::open(directory.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {  // NOLINT(*-vararg)
    while (fd_ >= 0 && ::flock(fd_, LOCK_EX) != 0 && errno == EINTR) {
    }
  }
  DirectoryLock(const DirectoryLock&) = delete;
  DirectoryLock& operator=(const DirectoryLock&) = delete;
  ~DirectoryLock() {
    if (fd_ >= 0) ::close(fd_);
  }

 private:
  int fd_;
};

}  // namespace

bool is_output_name(const std::string& name) {
  return std::ranges::find(output_names, name) != std::end(output_names);
}

OutputDirectory::OutputDirectory(const std::string& directory) {
  if (directory.empty()) return;
  final_ = directory;
  const auto refuse = [&](const std::string& why) {
    to_remove = nullptr;
    take_back();
    throw InputError("", "--out " + directory + ": " + why);
  };
  std::error_code error;
  for (fs::path p = final_; !p.empty() && !fs::exists(fs::symlink_status(p, error)); p = p.parent_path()) {
    if (p.has_filename()) created_.insert(created_.begin(), p);
    if (p == p.parent_path()) break;
  }
  error.clear();  // of files that do not exist
  if (!created_.empty()) fs::create_directories(final_, error);
  if (!error && !fs::is_directory(final_, error) && !error)
    error = std::make_error_code(std::errc::not_a_directory);
  if (error) refuse("no such directory can be made: " + error.message());
  for (const char* name : output_names) {
    if (fs::is_directory(final_ / name, error))
      refuse(std::string(name) + " is a directory there, a file is to replace it");
  }
  // A directory of an earlier run has one of these.
  constexpr const char* signs[] = {"summary.json",     "check.csv",           "campaign.json",
                                   "accuracy.json",    "comparison.json",     "design.json",
                                   "calibration.json", "identification.json", "margins.json",
                                   "plan.json",        "episode.json"};
  if (std::none_of(std::begin(signs), std::end(signs),
                   [&](const char* sign) { return fs::exists(final_ / sign, error); })) {
    for (const fs::directory_entry& e : fs::directory_iterator(final_, error)) {
      const std::string name = e.path().filename().string();
      if (!name.starts_with('.') && !unfinished(name))
        refuse(name + " is there, which no earlier run has left: take another directory");
    }
  }
  std::error_code ignored;
  for (const fs::directory_entry& e : fs::directory_iterator(final_, error)) {
    if (abandoned(e.path())) fs::remove_all(e.path(), ignored);
  }
  const fs::path partial = final_ / (partial_prefix + std::to_string(::getpid()));
  if (!error) fs::remove_all(partial, error);  // of a process of this number that was killed long ago
  std::vector<std::string> paths;
  for (const char* name : output_names) paths.push_back(partial / name);
  paths.push_back(partial);
  paths.insert(paths.end(), created_.rbegin(), created_.rend());
  unfinished_ = std::make_unique<const std::vector<std::string>>(std::move(paths));
  to_remove = unfinished_.get();
  [[maybe_unused]] static const int registered = std::at_quick_exit(remove_unfinished);
  if (!error) fs::create_directory(partial, error);
  if (error) refuse("cannot be written: " + error.message());
  partial_ = partial;
}

void OutputDirectory::take_back() const {
  std::error_code ignored;
  for (auto p = created_.rbegin(); p != created_.rend(); ++p)
    fs::remove(*p, ignored);  // if nothing was put there
}

OutputDirectory::~OutputDirectory() {
  if (to_remove == unfinished_.get()) to_remove = nullptr;
  if (partial_.empty()) return;
  std::error_code ignored;
  fs::remove_all(partial_, ignored);
  take_back();
}

std::string OutputDirectory::path(const std::string& name) const {
  return wanted() ? (partial_ / name).string() : std::string();
}

std::FILE* OutputDirectory::open(const std::string& name) const {
  if (against_ != nullptr) return against_->open(name);
  if (!wanted()) return nullptr;
  std::FILE* const f = std::fopen(path(name).c_str(), "wb");
  if (f == nullptr) throw InputError("", path(name) + ": cannot be written");
  return f;
}

void OutputDirectory::spare(const std::string& input, const std::string& copy) const {
  std::error_code error;
  for (const char* name : output_names) {
    if (wanted() && name != copy && fs::equivalent(final_ / name, input, error))
      throw InputError("", "--out " + final_.string() + ": " + name + " would replace " + input +
                               ", which is read; take another directory");
  }
}

void OutputDirectory::write(const std::string& name, const std::string& text) const {
  if (!wanted()) return;
  std::ofstream out(partial_ / name, std::ios::binary);
  out << text;
  out.close();
  if (!out) throw RunError((partial_ / name).string() + " could not be written completely (disk full?)");
}

void OutputDirectory::commit() {
  if (!wanted()) return;
  if (to_remove == unfinished_.get()) to_remove = nullptr;
  // Of two runs into one directory the files must not mix. Where a file system has no locks they may.
  const DirectoryLock alone(final_);
  std::vector<std::pair<fs::path, fs::path>> done;  // from, to
  try {
    std::vector<std::string> fresh;
    for (const fs::directory_entry& e : fs::directory_iterator(partial_))
      fresh.push_back(e.path().filename());
    const fs::path former = partial_ / "former";
    fs::create_directory(former);
    const auto move = [&](const fs::path& from, const fs::path& to) {
      if (fs::is_directory(from))
        throw fs::filesystem_error("", from, std::make_error_code(std::errc::is_a_directory));
      fs::rename(from, to);
      done.emplace_back(from, to);
    };
    // A file of an earlier run must not stand beside this run's summary.
    for (const char* name : output_names) {
      if (fs::exists(fs::symlink_status(final_ / name))) move(final_ / name, former / name);
    }
    for (const std::string& name : fresh) move(partial_ / name, final_ / name);
  } catch (const fs::filesystem_error& e) {
    std::error_code ignored;
    for (auto m = done.rbegin(); m != done.rend(); ++m) fs::rename(m->second, m->first, ignored);
    throw RunError("--out: " + e.path1().string() + " cannot be moved: " + e.code().message() +
                   "; nothing was changed there");
  }
  std::error_code ignored;
  fs::remove_all(partial_, ignored);
  partial_.clear();
}

std::string document_text(const nlohmann::ordered_json& document, int indent) {
  nlohmann::ordered_json stamped{{"schema", 1}};
  stamped.update(document);
  return json_text(stamped, indent) + "\n";
}

void publish(const StudyOutput& s, bool json, OutputDirectory& out) {
  const std::string document = document_text(s.document);
  std::string text = s.text;
  if (out.wanted()) {
    out.write(s.name + ".json", document);
    out.write("report.html", s.page());
    out.commit();
    text += fmt::format("report: {}/report.html\n", out.directory());
  }
  fmt::print("{}", json ? document : text);
}

void print_or_write(const std::string& text, const std::string& file) {
  if (file.empty()) {
    std::fwrite(text.data(), 1, text.size(), stdout);  // main looks at what became of it
    return;
  }
  const fs::path to(file), part(file + ".part-" + std::to_string(::getpid()));
  std::error_code error;
  for (const auto& p : {to, part}) {
    const fs::file_status there = symlink_status(p, error);
    if (exists(there) && !is_regular_file(there))
      throw InputError("", p.string() + ": exists and is not a regular file");
  }
  std::ofstream out(part, std::ios::binary);
  out << text;
  out.close();
  error.clear();
  if (out) fs::rename(part, to, error);
  if (!out || error) {
    fs::remove(part, error);
    throw InputError("", file + ": cannot be written");
  }
}

}  // namespace esmc::host
