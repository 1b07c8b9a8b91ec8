#include "host_sim/sweep/journal.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <span>
#include <string_view>

#include "firmware/link/crc.hpp"
#include "host_sim/error.hpp"

namespace esmc::host {
namespace {

constexpr std::string_view magic = "esmcswp1";
constexpr std::size_t head_size = 32;  // magic, identity, cases, objectives

std::uint32_t crc32(const char* data, std::size_t size) {
  return link::crc32(std::span(reinterpret_cast<const std::uint8_t*>(data), size));
}

bool write_all(int descriptor, const std::string& bytes) {
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t n = ::write(descriptor, bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    done += static_cast<std::size_t>(n);
  }
  return true;
}

}  // namespace

std::size_t Journal::record_size() const { return 16 + 8 * objectives_; }

void Journal::refuse(const std::string& why) {
  if (descriptor_ >= 0) ::close(descriptor_);
  throw InputError("", file_ + ": " + why);
}
void Journal::refuse_unwritable() { refuse(std::string("cannot be written: ") + std::strerror(errno)); }

Journal::Journal(const std::string& file, std::uint64_t identity, std::uint64_t cases, std::size_t columns,
                 bool restart)
    : file_(file), cases_(cases), objectives_(columns) {
  descriptor_ = ::open(file.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK,
                       0666);  // NOLINT(*-vararg)
  if (descriptor_ < 0) refuse_unwritable();
  if (::flock(descriptor_, LOCK_EX | LOCK_NB) != 0) refuse("another sweep is writing here");
  struct stat what {};
  if (::fstat(descriptor_, &what) != 0 || !S_ISREG(what.st_mode)) refuse("is not a regular file");
  if (what.st_nlink == 0) refuse("another sweep has just ended here");
  // A short head must begin as ours does.
  std::string begin(magic.size(), '\0');
  const ssize_t first = ::pread(descriptor_, begin.data(), begin.size(), 0);
  if (first < 0 || !magic.starts_with(begin.substr(0, static_cast<std::size_t>(first))))
    refuse("is not the journal of a sweep");
  if (restart && ::ftruncate(descriptor_, 0) != 0) refuse_unwritable();
  std::string head(magic);
  put(head, identity);
  put(head, cases);
  put(head, static_cast<std::uint64_t>(columns));
  std::string there(head_size, '\0');
  const ssize_t size = ::pread(descriptor_, there.data(), head_size, 0);
  if (size == static_cast<ssize_t>(head_size)) {
    if (there != head) {
      refuse(
          "is the journal of another sweep: specification, scene or program have changed since; take another "
          "--out, or --restart");
    }
    read_back();
  } else if (size < 0 || ::ftruncate(descriptor_, 0) != 0 || !write_all(descriptor_, head)) {
    refuse_unwritable();
  }
}

Journal::~Journal() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void Journal::read_back() {
  std::vector<bool> known(cases_, false);
  std::string record(record_size(), '\0');
  off_t at = head_size;
  const auto size = static_cast<ssize_t>(record.size());
  for (; ::pread(descriptor_, record.data(), record.size(), at) == size; at += size) {
    const std::size_t checked = record.size() - 4;
    std::size_t read = 0, crc = checked;
    if (take<std::uint32_t>(record, crc) != crc32(record.data(), checked)) break;
    Finished f = take_finished(record, read, objectives_);
    if (f.index >= cases_ || known[f.index]) continue;
    known[f.index] = true;
    found_.push_back(std::move(f));
  }
  if (::ftruncate(descriptor_, at) != 0) refuse_unwritable();
}

void Journal::append(const std::vector<Finished>& cases) {
  std::string bytes;
  bytes.reserve(cases.size() * record_size());
  for (const Finished& f : cases) {
    const std::size_t begin = bytes.size();
    put(bytes, f);
    put(bytes, crc32(bytes.data() + begin, bytes.size() - begin));
  }
  if (!write_all(descriptor_, bytes)) {
    throw RunError(file_ + ": cannot be written: " + std::strerror(errno) +
                   "; the same command goes on from here");
  }
}

void Journal::remove() { ::unlink(file_.c_str()); }

}  // namespace esmc::host
