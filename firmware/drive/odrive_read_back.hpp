#pragma once
/// Reads back the version and the configuration of an ODrive of firmware 0.6 before it is armed, one endpoint
/// at a time. Endpoint numbers belong to one version of the firmware, so the version is read first.

#include <array>
#include <cstdint>
#include <optional>

#include "firmware/drive/axis.hpp"
#include "firmware/drive/odrive.hpp"

namespace esmc::drive {

/// An endpoint and its allowed range.
struct OdriveCheck {
  std::uint16_t endpoint = 0;
  odrive::ValueType type = odrive::ValueType::f32;
  float lower = 0.0F, upper = 0.0F;  ///< both allowed; a NaN is not
};

/// The required configuration of a drive; empty: nothing is read back.
struct OdriveTable {
  static constexpr std::uint8_t checks_max = 12;
  std::array<OdriveCheck, checks_max> checks{};
  std::uint8_t count = 0;  ///< of `checks`
  bool check_version = false;
  std::array<std::uint8_t, 3> firmware{};  ///< major, minor, revision
};

/// Reads the entries of a table one by one and compares the answers. A question is the request of one entry;
/// the version, where it is checked, comes first.
class OdriveReadBack {
 public:
  static constexpr std::uint32_t patience_ticks = 25;  ///< from a question to its repetition
  static constexpr std::uint8_t attempts = 4;          ///< times that a question is sent

  OdriveReadBack() = default;
  explicit OdriveReadBack(const OdriveTable& table) : table_(table) {}

  /// True if every value was answered and is allowed; always with an empty table.
  [[nodiscard]] bool done() const { return next_ == questions(); }
  /// True once a value was not allowed, or not answered after four attempts; until restart().
  [[nodiscard]] bool config_mismatch() const { return config_mismatch_; }
  /// The last endpoint with a wrong value or no answer, until ask() sends a question; empty: none.
  [[nodiscard]] std::optional<std::uint16_t> refused() const { return refused_; }
  static constexpr std::uint16_t version_endpoint = 0xFFFF;  ///< stands for the version

  /// Clears all answers and config_mismatch(): the next ask() sends the first question.
  void restart() {
    next_ = 0;
    config_mismatch_ = false;
    withdraw();
  }

  /// Sends the next question to `node`, or repeats the last; every tick until done() or config_mismatch().
  /// `send(frame)` returns whether the bus took the frame; if not, the next call tries again.
  template <class Send>
  void ask(std::uint8_t node, Send&& send) {
    if (done() || config_mismatch_) return;
    if (wait_ticks_ > 0) {
      --wait_ticks_;
      return;
    }
    if (tries_ == attempts) {
      refuse();
      return;
    }
    if (!send(asks_version() ? odrive::encode_version_request(node)
                             : odrive::encode_read(node, check().endpoint)))
      return;
    asked_ = true;
    refused_.reset();
    ++tries_;
    wait_ticks_ = patience_ticks - 1;
  }

  /// Compares a Get_Version of the axis. not_mine, without effect: the version is not the present question,
  /// as when it comes cyclically; malformed: wrong length. The caller checks the identifier.
  Received take_version(const hal::CanFrame& f) {
    if (!asked_ || !asks_version() || f.remote) return Received::not_mine;
    const auto v = odrive::decode_version(f);
    if (!v) return Received::malformed;
    judge(*v == table_.firmware);
    return Received::accepted;
  }
  /// Compares a TxSdo of the axis. not_mine, without effect: another endpoint than the present question, as
  /// an answer to another node; malformed: too short for the value. The caller checks the identifier.
  Received take_value(const hal::CanFrame& f) {
    if (!asked_ || asks_version() || f.remote || f.size < 4 || odrive::endpoint_of(f) != check().endpoint) {
      return Received::not_mine;
    }
    const auto v = odrive::decode_value(f, check().type);
    if (!v) return Received::malformed;
    judge(check().lower <= *v && *v <= check().upper);
    return Received::accepted;
  }

 private:
  [[nodiscard]] std::uint8_t questions() const {
    return static_cast<std::uint8_t>((table_.check_version ? 1 : 0) + table_.count);
  }
  [[nodiscard]] bool asks_version() const { return table_.check_version && next_ == 0; }
  [[nodiscard]] const OdriveCheck& check() const {
    return table_.checks[next_ - (table_.check_version ? 1U : 0U)];
  }
  void withdraw() {
    asked_ = false;
    tries_ = 0;
    wait_ticks_ = 0;
  }
  void judge(bool good) {
    withdraw();
    if (good) {
      ++next_;
    } else {
      refuse();
    }
  }
  void refuse() {
    config_mismatch_ = true;
    refused_ = asks_version() ? version_endpoint : check().endpoint;
  }

  OdriveTable table_{};
  std::optional<std::uint16_t> refused_;
  std::uint32_t wait_ticks_ = 0;
  std::uint8_t next_ = 0;
  std::uint8_t tries_ = 0;
  bool asked_ = false;  // and not answered
  bool config_mismatch_ = false;
};

}  // namespace esmc::drive
