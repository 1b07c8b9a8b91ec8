#include "host_sim/bus/wire.hpp"

namespace esmc::host {
namespace {

/// Takes the bits of a frame in order: keeps the classic CRC over them and puts the stuff bits in.
class Writer {
 public:
  void put(std::uint32_t value, int bits) {
    for (int i = bits - 1; i >= 0; --i) put(((value >> static_cast<unsigned>(i)) & 1U) != 0);
  }
  void put(bool bit) {
    const bool next = bit != ((crc_ & 0x4000U) != 0);
    crc_ = (crc_ << 1U) & 0x7FFFU;
    if (next) crc_ ^= 0x4599U;  // x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1
    send(bit);
  }
  [[nodiscard]] const WireFrame& finish() {
    const std::uint32_t crc = crc_;
    for (unsigned i = 15; i-- > 0;) send(((crc >> i) & 1U) != 0);
    return out_;
  }
  /// For a frame that goes on with a fixed stuff bit, which takes the place of one that is due here.
  [[nodiscard]] const WireFrame& finish_at_fixed_bit() {
    const std::uint32_t due = stuffed_last_ ? 1 : 0;
    out_.size -= due;
    out_.stuffed -= due;
    return out_;
  }
  void switch_rate() { out_.slow = out_.size; }

 private:
  void append(bool bit) { out_.bit[out_.size++] = bit; }
  void send(bool bit) {
    append(bit);
    run_ = bit == last_ ? run_ + 1 : 1;
    last_ = bit;
    stuffed_last_ = run_ == 5;
    if (run_ < 5) return;
    append(!bit);  // also behind the last bit of the CRC
    ++out_.stuffed;
    last_ = !bit;
    run_ = 1;
  }

  WireFrame out_;
  std::uint32_t crc_ = 0;
  int run_ = 0;
  bool last_ = true;  // idle
  bool stuffed_last_ = false;
};

}  // namespace

WireFrame on_the_wire(const hal::CanFrame& f) {
  Writer w;
  w.put(false);  // start of frame
  w.put(f.extended ? f.id >> 18U : f.id, 11);
  if (f.extended) {
    w.put(0b11, 2);  // SRR, IDE
    w.put(f.id & 0x3'FFFFU, 18);
  }
  if (f.fd) {
    w.put(0b010, f.extended ? 3 : 4);  // RRS, IDE of a base frame; FDF, res
    w.put(f.bit_rate_switch);
    if (f.bit_rate_switch) w.switch_rate();
    w.put(false);  // ESI: error active
    w.put(hal::can_fd_code(f.size), 4);
  } else {
    w.put(f.remote);
    w.put(0, 2);  // IDE of a base frame, else r1; r0
    w.put(f.size, 4);
  }
  if (!f.remote) {
    for (const std::uint8_t byte : f.payload()) w.put(byte, 8);
  }
  return f.fd ? w.finish_at_fixed_bit() : w.finish();
}

}  // namespace esmc::host
