#include "host_sim/commands/output.hpp"

#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <system_error>

#include "host_sim/error.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

namespace fs = std::filesystem;

namespace {

/// Every name that a command may leave.
constexpr const char* output_names[] = {"scene.toml",  "summary.json", "log.csv",     "frames.log",
                                        "report.html", "check.csv",    reference_copy, "sweep.toml",
                                        "cases.csv",   "timing.json",  "timing.csv"};

/// Of two files that are moved, so that it can be undone.
struct Move {
  fs::path from, to;
};

}  // namespace

OutputDirectory::OutputDirectory(const std::string& directory) {
  if (directory.empty()) return;
  final_ = directory;
  const auto refuse = [&](const std::string& why) {
    take_back();
    throw InputError("", "--out " + directory + ": " + why);
  };
  std::error_code error;
  for (fs::path p = final_; !p.empty() && !fs::exists(p, error) && !error; p = p.parent_path()) {
    if (p.has_filename()) created_.insert(created_.begin(), p);
    if (p == p.parent_path()) break;
  }
  if (!error && !created_.empty()) fs::create_directories(final_, error);
  if (!error && !fs::is_directory(final_, error) && !error)
    error = std::make_error_code(std::errc::not_a_directory);
  if (error) refuse("no such directory can be made: " + error.message());
  for (const char* name : output_names) {
    if (fs::is_directory(final_ / name, error))
      refuse(std::string(name) + " is a directory there, a file is to replace it");
  }
  const fs::path partial = final_ / (".partial-" + std::to_string(::getpid()));
  fs::remove_all(partial, error);  // of a process that was killed long ago
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
  if (partial_.empty()) return;
  std::error_code ignored;
  fs::remove_all(partial_, ignored);
  take_back();
}

std::string OutputDirectory::path(const std::string& name) const {
  return wanted() ? (partial_ / name).string() : std::string();
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
  std::vector<Move> done;
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
      done.push_back({from, to});
    };
    // A file of an earlier run must not stand beside this run's summary.
    for (const char* name : output_names) {
      if (fs::exists(fs::symlink_status(final_ / name))) move(final_ / name, former / name);
    }
    for (const std::string& name : fresh) move(partial_ / name, final_ / name);
  } catch (const fs::filesystem_error& e) {
    std::error_code ignored;
    for (auto m = done.rbegin(); m != done.rend(); ++m) fs::rename(m->to, m->from, ignored);
    throw RunError("--out: " + e.path1().string() + " cannot be moved: " + e.code().message() +
                   "; nothing was changed there");
  }
  std::error_code ignored;
  fs::remove_all(partial_, ignored);
  partial_.clear();
}

void print_or_write(const std::string& text, const std::string& file) {
  if (file.empty()) {
    std::fwrite(text.data(), 1, text.size(), stdout);  // main looks at what became of it
    return;
  }
  const fs::path to(file), part(file + ".part");
  for (const auto& p : {to, part}) {
    if (exists(symlink_status(p)) && !is_regular_file(symlink_status(p)))
      throw InputError("", p.string() + ": exists and is not a regular file");
  }
  std::ofstream out(part, std::ios::binary);
  out << text;
  out.close();
  std::error_code error;
  if (out) fs::rename(part, to, error);
  if (!out || error) {
    fs::remove(part, error);
    throw InputError("", file + ": cannot be written");
  }
}

}  // namespace esmc::host
