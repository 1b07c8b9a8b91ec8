#include "host_sim/record/mcap.hpp"

#include <algorithm>
#include <array>
#include <concepts>

#include "firmware/link/crc.hpp"
#include "host_sim/error.hpp"

namespace esmc::host {
namespace {

constexpr std::string_view magic("\x89MCAP0\r\n", 8);
constexpr std::size_t chunk_bytes = 1U << 19U;

enum class Op : std::uint8_t {
  header = 1,
  footer = 2,
  schema = 3,
  channel = 4,
  message = 5,
  chunk = 6,
  message_index = 7,
  chunk_index = 8,
  statistics = 11,
  summary_offset = 14,
  data_end = 15,
};

template <std::unsigned_integral T>
void append(std::string& to, T value) {
  for (std::size_t i = 0; i < sizeof(T); ++i)
    to += static_cast<char>(static_cast<std::uint64_t>(value) >> (8U * i));
}
void append(std::string& to, std::string_view text) {
  append(to, static_cast<std::uint32_t>(text.size()));
  to += text;
}
/// Appends numbers, little-endian, and texts after their lengths.
template <class... Fields>
void put(std::string& to, const Fields&... fields) {
  (append(to, fields), ...);
}
template <class... Fields>
std::string packed(const Fields&... fields) {
  std::string out;
  put(out, fields...);
  return out;
}
std::string record(Op op, std::string_view content) {
  std::string out = packed(static_cast<std::uint8_t>(op), std::uint64_t{content.size()});
  return out.append(content);
}

}  // namespace

void Crc32::add(std::string_view bytes) {
  static constexpr auto table = [] {
    std::array<std::uint32_t, 256> t{};
    for (std::uint32_t i = 0; i < 256; ++i) t[i] = link::crc32_add(i, 0);
    return t;
  }();
  for (const char c : bytes) crc_ = table[(crc_ ^ static_cast<std::uint8_t>(c)) & 0xFFU] ^ (crc_ >> 8U);
}

void McapWriter::Span::add(std::uint64_t t) {
  first = std::min(first, t);
  last = std::max(last, t);
}

McapWriter::McapWriter(std::FILE* file) : file_(file) {
  write(magic);
  write(record(Op::header, packed("", "esmc")));  // profile, program
}

void McapWriter::write(std::string_view bytes) {
  std::fwrite(bytes.data(), 1, bytes.size(), file_.get());  // close() looks at what became of it
  data_crc_.add(bytes);
  at_ += bytes.size();
}

std::uint16_t McapWriter::channel(const std::string& topic, const std::string& schema_name,
                                  const std::string& schema) {
  const auto id = static_cast<std::uint16_t>(channels_.size()),
             schema_id = static_cast<std::uint16_t>(id + 1);  // 0: no schema
  constexpr std::uint32_t metadata = 0;
  channels_.push_back({record(Op::schema, packed(schema_id, schema_name, "jsonschema", schema)),
                       record(Op::channel, packed(id, schema_id, topic, "json", metadata)),
                       0,
                       {}});
  chunk_ += channels_.back().schema + channels_.back().record;
  return id;
}

void McapWriter::message(std::uint16_t channel, std::uint64_t time_ns, std::string_view json) {
  Channel& to = channels_[channel];
  to.index.emplace_back(time_ns, chunk_.size());
  chunk_ += static_cast<char>(Op::message);
  put(chunk_, std::uint64_t{2 + 4 + 8 + 8 + json.size()}, channel, to.messages++, time_ns, time_ns);
  chunk_ += json;
  chunk_time_.add(time_ns);
  time_.add(time_ns);
  if (chunk_.size() >= chunk_bytes) end_chunk();
}

void McapWriter::end_chunk() {
  if (chunk_.empty()) return;
  Crc32 crc;
  crc.add(chunk_);
  const std::uint64_t begin = at_, size = chunk_.size();
  constexpr const char* compression = "";
  write(record(Op::chunk,
               packed(chunk_time_.begin(), chunk_time_.last, size, crc.value(), compression, size) + chunk_));
  const std::uint64_t end = at_;
  std::string offsets;
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    auto& index = channels_[i].index;
    if (index.empty()) continue;
    const auto id = static_cast<std::uint16_t>(i);
    put(offsets, id, at_);
    std::string entries;
    for (const auto& [time, offset] : index) put(entries, time, offset);
    index.clear();
    write(record(Op::message_index, packed(id, entries)));
  }
  chunk_indexes_ += record(Op::chunk_index, packed(chunk_time_.begin(), chunk_time_.last, begin, end - begin,
                                                   offsets, at_ - end, compression, size, size));
  chunk_.clear();
  chunk_time_ = {};
  ++chunks_;
}

std::string McapWriter::statistics() const {
  std::string counts;
  std::uint64_t messages = 0;
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    put(counts, static_cast<std::uint16_t>(i), std::uint64_t{channels_[i].messages});
    messages += channels_[i].messages;
  }
  const auto channels = static_cast<std::uint32_t>(channels_.size());
  constexpr std::uint32_t attachments = 0, metadata = 0;
  return record(Op::statistics, packed(messages, static_cast<std::uint16_t>(channels), channels, attachments,
                                       metadata, chunks_, time_.begin(), time_.last, counts));
}

void McapWriter::close() {
  end_chunk();
  write(record(Op::data_end, packed(data_crc_.value())));
  const std::uint64_t summary = at_;
  std::string schemas, channels, text, groups;
  for (const Channel& c : channels_) {
    schemas += c.schema;
    channels += c.record;
  }
  const std::string statistics = this->statistics();
  using Group = std::pair<Op, const std::string*>;
  for (const auto& [op, part] :
       {Group{Op::schema, &schemas}, Group{Op::channel, &channels}, Group{Op::statistics, &statistics},
        Group{Op::chunk_index, &chunk_indexes_}}) {
    const std::uint64_t begin = summary + text.size(), size = part->size();
    if (size > 0) groups += record(Op::summary_offset, packed(static_cast<std::uint8_t>(op), begin, size));
    text += *part;
  }
  const std::uint64_t offsets = summary + text.size();
  text += groups;
  // The checksum covers the footer up to itself.
  put(text, static_cast<std::uint8_t>(Op::footer), std::uint64_t{8 + 8 + 4}, summary, offsets);
  Crc32 crc;
  crc.add(text);
  put(text, crc.value());
  text += magic;
  write(text);
  const bool whole = std::ferror(file_.get()) == 0;
  if (std::fclose(file_.release()) != 0 || !whole)
    throw RunError("the MCAP file could not be written completely (disk full?)");
}

}  // namespace esmc::host
