#pragma once
/// A directory for readers of files that does not touch the disk.

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <array>
#include <filesystem>
#include <string>

#include "tests/fuzz/bytes.hpp"
#include "tests/fuzz/recording_reader.hpp"

namespace esmc::fuzz {

/// A directory whose files lie in memory: links to open files, and where such a file is closed there is none.
/// Under a name that does not change: the fuzzer learns from what is compared.
class Folder {
 public:
  Folder() {
    std::string path = (std::filesystem::temp_directory_path() / "recording.XXXXXX").string();
    require(mkdtemp(path.data()) != nullptr &&
                dup2(open(path.c_str(), O_RDONLY | O_DIRECTORY), first - 1) == first - 1,
            "a directory");
    made_ = path;
    for (std::size_t i = 0; i < file_names.size(); ++i) {
      memory_[i] = memfd_create("input", 0);
      require(memory_[i] >= 0, "a file in memory");
      std::filesystem::create_symlink("/proc/self/fd/" + std::to_string(first + static_cast<int>(i)),
                                      path + "/" + file_names[i]);
    }
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  ~Folder() {
    std::error_code error;
    std::filesystem::remove_all(made_, error);
  }

  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] std::string file(const std::string& name) const { return path_ + "/" + name; }
  void write(std::size_t i, const std::string& text) {
    require(ftruncate(memory_[i], 0) == 0 &&
                pwrite(memory_[i], text.data(), text.size(), 0) == static_cast<ssize_t>(text.size()) &&
                dup2(memory_[i], first + static_cast<int>(i)) >= 0,
            "a file in memory");
  }
  void remove(std::size_t i) { close(first + static_cast<int>(i)); }
  /// Something is there that is no file.
  void occupy(std::size_t i) {
    static const int directory = open("/", O_RDONLY | O_DIRECTORY);
    require(dup2(directory, first + static_cast<int>(i)) >= 0, "a directory instead of a file");
  }

 private:
  static constexpr int first = 100;
  std::string made_, path_ = "/proc/self/fd/" + std::to_string(first - 1);
  std::array<int, file_names.size()> memory_{};
};

inline Folder& folder() {
  static Folder the;
  return the;
}

}  // namespace esmc::fuzz
