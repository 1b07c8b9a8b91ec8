#include "host_sim/commands/output.hpp"

#include <unistd.h>

#include <fstream>
#include <system_error>

#include "host_sim/error.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

namespace fs = std::filesystem;

OutputDirectory::OutputDirectory(const std::string& directory) {
  if (directory.empty()) return;
  final_ = directory;
  std::error_code error;
  created_ = !fs::exists(final_, error);
  if (created_) fs::create_directories(final_, error);
  if (!error && !fs::is_directory(final_)) error = std::make_error_code(std::errc::not_a_directory);
  if (error)
    throw InputError("", "--out " + directory + ": no such directory can be made: " + error.message());
  partial_ = final_ / (".partial-" + std::to_string(::getpid()));
  fs::create_directory(partial_, error);
  if (error) throw InputError("", "--out " + directory + ": cannot be written: " + error.message());
}

OutputDirectory::~OutputDirectory() {
  std::error_code ignored;
  if (!partial_.empty()) {
    fs::remove_all(partial_, ignored);
    if (created_) fs::remove(final_, ignored);  // succeeds only when nothing was put there
  }
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
  // A file of an earlier run must not stand beside this run's summary.
  for (const char* name :
       {"scene.toml", "summary.json", "log.csv", "frames.log", "report.html", "check.csv", reference_copy}) {
    if (!fs::exists(partial_ / name)) fs::remove(final_ / name);
  }
  for (const fs::directory_entry& e : fs::directory_iterator(partial_)) {
    fs::rename(e.path(), final_ / e.path().filename());
  }
  fs::remove(partial_);
  partial_.clear();
}

}  // namespace esmc::host
