#pragma once
/// MCAP 1.0 files, as Foxglove, Rerun and PlotJuggler read them: chunks without compression, with index and
/// checksums. Specification: https://mcap.dev/spec

#include <cstdint>
#include <cstdio>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "host_sim/file_handle.hpp"

namespace esmc::host {

/// CRC-32/ISO-HDLC, byte by byte from a table.
class Crc32 {
 public:
  void add(std::string_view bytes);
  [[nodiscard]] std::uint32_t value() const { return ~crc_; }

 private:
  std::uint32_t crc_ = 0xFFFF'FFFFU;
};

class McapWriter {
 public:
  /// Writes to `file`, which it closes at the end.
  explicit McapWriter(std::FILE* file);
  /// Adds a channel of JSON messages and returns its number, from 0. `schema`: a JSON Schema.
  std::uint16_t channel(const std::string& topic, const std::string& schema_name, const std::string& schema);
  /// Adds a message at `time_ns`, not negative. `json` is one object.
  void message(std::uint16_t channel, std::uint64_t time_ns, std::string_view json);
  /// Writes what is left, index and end, and closes the file. Throws RunError when it could not be written
  /// completely.
  void close();

 private:
  struct Channel {
    std::string schema, record;  ///< as in the summary
    std::uint32_t messages = 0;
    std::vector<std::pair<std::uint64_t, std::uint64_t>> index;  ///< of the present chunk: time, offset
  };
  struct Span {
    std::uint64_t first = ~std::uint64_t{0}, last = 0;
    void add(std::uint64_t t);
    [[nodiscard]] std::uint64_t begin() const { return first > last ? 0 : first; }
  };

  void write(std::string_view bytes);
  void end_chunk();
  [[nodiscard]] std::string statistics() const;

  FileHandle file_;
  std::uint64_t at_ = 0;  ///< bytes written
  Crc32 data_crc_;
  std::vector<Channel> channels_;
  std::string chunk_, chunk_indexes_;
  Span chunk_time_, time_;
  std::uint32_t chunks_ = 0;
};

}  // namespace esmc::host
