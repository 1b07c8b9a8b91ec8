#pragma once
/// A file of the C library that closes itself.

#include <cstdio>
#include <memory>

namespace esmc::host {

struct FileCloser {
  void operator()(std::FILE* f) const { std::fclose(f); }
};
/// Null: no file.
using FileHandle = std::unique_ptr<std::FILE, FileCloser>;

}  // namespace esmc::host
