#include "host_sim/record/mcap.hpp"

#include <algorithm>
#include <array>

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

template <class T>
void put(std::string& to, T value) {
  for (std::size_t i = 0; i < sizeof(T); ++i)
    to += static_cast<char>(static_cast<std::uint64_t>(value) >> (8U * i));
}
void put_text(std::string& to, std::string_view text) {
  put(to, static_cast<std::uint32_t>(text.size()));
  to += text;
}
std::string record(Op op, std::string_view content) {
  std::string out(1, static_cast<char>(op));
  put(out, std::uint64_t{content.size()});
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
  std::string content;
  put_text(content, "");  // profile
  put_text(content, "esmc");
  write(magic);
  write(record(Op::header, content));
}

void McapWriter::write(std::string_view bytes) {
  std::fwrite(bytes.data(), 1, bytes.size(), file_.get());  // close() looks at what became of it
  data_crc_.add(bytes);
  at_ += bytes.size();
}

std::uint16_t McapWriter::channel(const std::string& topic, const std::string& schema_name,
                                  const std::string& schema) {
  const auto id = static_cast<std::uint16_t>(channels_.size());
  std::string s, c;
  put(s, static_cast<std::uint16_t>(id + 1));  // 0: no schema
  put_text(s, schema_name);
  put_text(s, "jsonschema");
  put_text(s, schema);
  put(c, id);
  put(c, static_cast<std::uint16_t>(id + 1));
  put_text(c, topic);
  put_text(c, "json");
  put(c, std::uint32_t{0});  // metadata
  channels_.push_back({record(Op::schema, s), record(Op::channel, c), 0, {}});
  chunk_ += channels_.back().schema + channels_.back().record;
  return id;
}

void McapWriter::message(std::uint16_t channel, std::uint64_t time_ns, std::string_view json) {
  Channel& to = channels_[channel];
  to.index.emplace_back(time_ns, chunk_.size());
  chunk_ += static_cast<char>(Op::message);
  put(chunk_, std::uint64_t{2 + 4 + 8 + 8 + json.size()});
  put(chunk_, channel);
  put(chunk_, to.messages++);
  put(chunk_, time_ns);
  put(chunk_, time_ns);
  chunk_ += json;
  chunk_time_.add(time_ns);
  time_.add(time_ns);
  if (chunk_.size() >= chunk_bytes) end_chunk();
}

void McapWriter::end_chunk() {
  if (chunk_.empty()) return;
  Crc32 crc;
  crc.add(chunk_);
  std::string content;
  put(content, chunk_time_.begin());
  put(content, chunk_time_.last);
  put(content, std::uint64_t{chunk_.size()});
  put(content, crc.value());
  put_text(content, "");  // no compression
  put(content, std::uint64_t{chunk_.size()});
  content += chunk_;
  const std::uint64_t begin = at_;
  write(record(Op::chunk, content));
  const std::uint64_t end = at_;
  std::string offsets;
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    auto& index = channels_[i].index;
    if (index.empty()) continue;
    put(offsets, static_cast<std::uint16_t>(i));
    put(offsets, at_);
    std::string entry;
    put(entry, static_cast<std::uint16_t>(i));
    put(entry, static_cast<std::uint32_t>(16 * index.size()));
    for (const auto& [time, offset] : index) {
      put(entry, time);
      put(entry, offset);
    }
    index.clear();
    write(record(Op::message_index, entry));
  }
  std::string c;
  put(c, chunk_time_.begin());
  put(c, chunk_time_.last);
  put(c, begin);
  put(c, end - begin);
  put_text(c, offsets);
  put(c, at_ - end);
  put_text(c, "");
  put(c, std::uint64_t{chunk_.size()});
  put(c, std::uint64_t{chunk_.size()});
  chunk_indexes_ += record(Op::chunk_index, c);
  chunk_.clear();
  chunk_time_ = {};
  ++chunks_;
}

std::string McapWriter::statistics() const {
  std::string counts, out;
  std::uint64_t messages = 0;
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    put(counts, static_cast<std::uint16_t>(i));
    put(counts, std::uint64_t{channels_[i].messages});
    messages += channels_[i].messages;
  }
  put(out, messages);
  put(out, static_cast<std::uint16_t>(channels_.size()));
  put(out, static_cast<std::uint32_t>(channels_.size()));
  put(out, std::uint64_t{0});  // attachments, metadata
  put(out, chunks_);
  put(out, time_.begin());
  put(out, time_.last);
  put_text(out, counts);
  return record(Op::statistics, out);
}

void McapWriter::close() {
  end_chunk();
  std::string end;
  put(end, data_crc_.value());
  write(record(Op::data_end, end));
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
    std::string group(1, static_cast<char>(op));
    put(group, summary + text.size());
    put(group, std::uint64_t{part->size()});
    if (!part->empty()) groups += record(Op::summary_offset, group);
    text += *part;
  }
  const std::uint64_t offsets = summary + text.size();
  text += groups;
  // The checksum covers the footer up to itself.
  std::string footer(1, static_cast<char>(Op::footer));
  put(footer, std::uint64_t{8 + 8 + 4});
  put(footer, summary);
  put(footer, offsets);
  text += footer;
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
