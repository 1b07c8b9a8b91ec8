#pragma once
/// Statistics and rows of ticks, recorded without waiting.

#include <array>
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <string>
#include <thread>
#include <vector>

namespace esmc {

/// Histogram of times in whole microseconds; a millisecond or more falls into the bin 1000.
class Histogram {
 public:
  /// Adds a time, us.
  void add(std::uint32_t us) {
    ++bins_[us < bins_.size() ? us : bins_.size() - 1];
    ++count_;
    if (us > most_) most_ = us;
  }
  [[nodiscard]] std::uint64_t count() const { return count_; }  ///< values added
  [[nodiscard]] std::uint32_t most() const { return most_; }    ///< largest value, us, not cut at 1000
  /// The value, us, that a share (0..1) of all does not exceed; 1000: that or more. 0 if nothing was added.
  [[nodiscard]] std::uint32_t quantile(double share) const {
    std::uint64_t seen = 0;
    for (std::uint32_t us = 0; us < bins_.size(); ++us) {
      seen += bins_[us];
      if (static_cast<double>(seen) >= share * static_cast<double>(count_)) return us;
    }
    return 0;
  }
  /// Writes rows "name,us,count" of the bins that are not empty.
  void write(std::FILE* out, const char* name) const {
    for (std::size_t us = 0; us < bins_.size(); ++us) {
      if (bins_[us] > 0)
        std::fprintf(out, "%s,%zu,%llu\n", name, us, static_cast<unsigned long long>(bins_[us]));
    }
  }

 private:
  std::array<std::uint64_t, 1001> bins_{};
  std::uint64_t count_ = 0;
  std::uint32_t most_ = 0;
};

/// A ring of `size` rows that a thread writes to a file. push() never waits: a full ring drops rows.
template <class Row, std::size_t size = 16384>
class Recorder {
 public:
  /// `write(FILE*, row)` writes a row, on the thread; it is copied. `file` must stay open until close();
  /// null: nothing is recorded.
  template <class Write>
  Recorder(std::FILE* file, const Write& write) : rows_(size) {
    if (file == nullptr) return;
    reader_ = std::thread([this, file, write] {
      while (true) {
        const bool last = over_.load(std::memory_order_acquire);
        std::size_t tail = tail_.load(std::memory_order_relaxed);
        for (; tail != head_.load(std::memory_order_acquire);
             tail_.store(++tail, std::memory_order_release)) {
          write(file, rows_[tail % size]);
        }
        if (last) return;
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
      }
    });
  }
  ~Recorder() { close(); }
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// Adds a copy of a row; drops it if the ring is full. Call from one thread.
  void push(const Row& row) {
    if (!reader_.joinable()) return;
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (head - tail_.load(std::memory_order_acquire) == size) {
      ++lost_;
      return;
    }
    rows_[head % size] = row;
    head_.store(head + 1, std::memory_order_release);
  }
  [[nodiscard]] std::uint64_t lost() const { return lost_; }  ///< number of dropped rows
  /// Waits until the rest of the ring is written; rows pushed later are dropped. The file stays open.
  void close() {
    over_.store(true, std::memory_order_release);
    if (reader_.joinable()) reader_.join();
  }

 private:
  std::vector<Row> rows_;
  std::atomic<std::size_t> head_{0}, tail_{0};
  std::atomic<bool> over_{false};
  std::uint64_t lost_ = 0;
  std::thread reader_;
};

}  // namespace esmc
