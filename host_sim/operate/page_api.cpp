#include "host_sim/operate/page_api.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <memory>
#include <utility>

#include "host_sim/error.hpp"
#include "host_sim/json_text.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;
using Lock = std::scoped_lock<std::mutex>;

constexpr std::size_t rows_kept = 4000, events_kept = 200, orders_max = 8, words_max = 4, word_max = 64;
constexpr int messages_per_second = 200;    // a page sends one for each of ours, 50 a second
constexpr std::size_t unanswered_max = 25;  // 0.5 s

/// From number `from` on, as a JSON array; `from` becomes end().
std::string array(const History<std::string>& lines, std::uint64_t& from) {
  std::string out;
  for (from = std::max(from, lines.first); from < lines.end(); ++from)
    out += (out.empty() ? "[" : ",") + lines.at(from);
  return out + "]";
}

std::string word(const Json& j) {
  if (!j.is_string() || j.get_ref<const std::string&>().size() > word_max) throw Malformed();
  return j.get<std::string>();
}

}  // namespace

/// A page that is connected. It answers each message with its number: that it is there, and how late.
class OperatorPage final : public Client {
 public:
  explicit OperatorPage(PageApi& api) : api_(api), row_(api.rows_.first), event_(api.events_.first) {
    if (api_.word_ == nullptr) api_.give_word(this);
  }
  ~OperatorPage() override {
    const Lock lock(api_.mutex_);
    if (api_.word_ != this) return;
    api_.raise(PageApi::Stop::left);
    api_.give_word(nullptr);
  }
  OperatorPage(const OperatorPage&) = delete;
  OperatorPage& operator=(const OperatorPage&) = delete;

  [[nodiscard]] std::string next() override {
    const Lock lock(api_.mutex_);
    if (number_ - answered_ >= unanswered_max)
      return {};  // the page does not keep up: skip states that are out of date
    sent_[++number_ % sent_.size()] = PageApi::Clock::now();
    std::string out = fmt::format("{{\"n\":{},\"word\":{}", number_, api_.word_ == this);
    if (!std::exchange(greeted_, true)) out += ",\"hello\":" + api_.hello_;
    out += ",\"now\":" + api_.now_;
    if (row_ < api_.rows_.end()) out += ",\"rows\":" + array(api_.rows_, row_);
    if (event_ < api_.events_.end()) out += ",\"events\":" + array(api_.events_, event_);
    if (!answers_.empty()) out += ",\"answers\":" + json_text(std::exchange(answers_, {}));
    return out + "}";
  }

  void on_message(std::string_view message) override {
    const Lock lock(api_.mutex_);
    const auto now = PageApi::Clock::now();
    if (now - second_ > std::chrono::seconds(1)) second_ = now, messages_ = 0;
    const bool flood = ++messages_ > messages_per_second;
    try {
      const Json j = parse_json(message, false);
      if (!j.is_object()) throw Malformed();
      if (j.contains("stop"))
        stop(word(j["stop"]));  // also from a page that only watches, and beyond the limit of messages
      if (flood) throw Malformed();
      apply(j);
    } catch (const Malformed&) {
      ++api_.malformed_;
    } catch (const InputError& e) {
      if (answers_.size() < orders_max) answers_.emplace_back(printable(e.what()));
    }
  }

 private:
  void stop(const std::string& how) {
    if (how != "halt" && how != "off") throw Malformed();
    api_.raise(how == "off" ? PageApi::Stop::off : PageApi::Stop::halt);
  }
  void apply(const Json& j) {
    for (const auto& [key, value] : j.items()) {
      if (key == "stop") continue;
      if (key == "here") {
        here(value);
      } else if (key == "take") {
        if (api_.word_ != this) api_.give_word(this);
      } else if (key == "jog" && value.is_null()) {
        if (api_.word_ == this) api_.jog_ = 0;
      } else if (key == "jog" || key == "do") {
        order(key == "jog", value);
      } else {
        throw Malformed();
      }
    }
  }
  /// The answer to message `j`: the page was there when that was sent, whenever this comes.
  void here(const Json& j) {
    if (!j.is_number_unsigned()) throw Malformed();
    const auto n = j.get<std::uint64_t>();
    if (n <= answered_ || n > number_) throw Malformed();
    answered_ = n;
    const auto sent = sent_[n % sent_.size()];
    there_ = std::max(there_, sent);
    if (api_.word_ != this || PageApi::Clock::now() - sent > api_.absence_) return;
    api_.life_ = std::max(api_.life_, sent);
    api_.life_taken_ = api_.absent_ = false;
  }
  void order(bool jog, const Json& j) {
    if (!j.is_array() || j.empty() || j.size() > words_max) throw Malformed();
    PageApi::Words words;
    for (const Json& w : j) words.push_back(word(w));
    if (jog) {
      if (words.size() != 2) throw Malformed();
      words.insert(words.begin(), "jog");
    } else if (std::ranges::find(api_.allowed_, std::string_view(words.front())) == api_.allowed_.end()) {
      throw Malformed();
    }
    if (api_.word_ != this) throw InputError("", "not_now: another page has the word; take it over first");
    // Behind a tunnel that was stalled a click may come when its operator has long gone.
    if (PageApi::Clock::now() - there_ > api_.absence_)
      throw InputError("", "not_now: this page answers too late for orders; its stop works");
    if (api_.stop_ != PageApi::Stop::none) return;  // given before its operator has seen the stop
    if (api_.orders_.size() >= orders_max) throw InputError("", "not_now: orders are waiting already");
    if (jog) api_.jog_ = ++api_.jogs_;
    api_.orders_.push_back({std::move(words), jog ? api_.jog_ : 0});
  }

  PageApi& api_;
  std::uint64_t row_, event_, number_ = 0, answered_ = 0;
  std::array<PageApi::Clock::time_point, unanswered_max> sent_{};  ///< when, by number
  PageApi::Clock::time_point there_{};  ///< when the newest message that it has answered was sent
  bool greeted_ = false;
  PageApi::Clock::time_point second_{};
  int messages_ = 0;
  std::vector<std::string> answers_;
};

PageApi::PageApi(const Json& hello, std::vector<std::string_view> allowed, Clock::duration window,
                 Clock::duration absence)
    : hello_(json_text(hello)), allowed_(std::move(allowed)), window_(window), absence_(absence) {}
PageApi::~PageApi() = default;

std::unique_ptr<Client> PageApi::on_connect() {
  const Lock lock(mutex_);
  return std::make_unique<OperatorPage>(*this);
}

void PageApi::raise(Stop s) {
  stop_ = std::max(stop_, s);
  orders_.clear();
  jog_ = 0;
}

void PageApi::give_word(const OperatorPage* to) {
  word_ = to;
  orders_.clear();
  jog_ = 0;
  life_ = Clock::now();  // its page has some time to answer
  life_taken_ = true;
  absent_ = false;
}

void PageApi::publish(std::string now) {
  const Lock lock(mutex_);
  now_ = std::move(now);
}
void PageApi::add_row(std::string row) {
  const Lock lock(mutex_);
  rows_.add(std::move(row), rows_kept);
}
void PageApi::tell(double t, const char* kind, const std::string& text) {
  const Lock lock(mutex_);
  events_.add(json_text({{"t", t}, {"kind", kind}, {"text", printable(text)}}), events_kept);
}

std::optional<PageApi::Order> PageApi::next_order() {
  const Lock lock(mutex_);
  if (orders_.empty() || stop_ != Stop::none) return std::nullopt;
  Order o = std::move(orders_.front());
  orders_.pop_front();
  return o;
}

PageApi::Stop PageApi::stop() {
  const Lock lock(mutex_);
  // A page that hangs has left as well, once, and before the controller misses its sign of life.
  if (word_ != nullptr && !absent_ && Clock::now() - life_ > absence_) {
    absent_ = true;
    raise(Stop::left);
  }
  return stop_;
}
void PageApi::stop_done(Stop carried_out) {
  const Lock lock(mutex_);
  if (stop_ == carried_out) stop_ = Stop::none;
}

bool PageApi::take_life() {
  const Lock lock(mutex_);
  return !std::exchange(life_taken_, true);
}

bool PageApi::held(std::uint64_t jog) {
  const Lock lock(mutex_);
  return jog_ == jog && Clock::now() - life_ <= window_;
}

std::uint64_t PageApi::malformed() {
  const Lock lock(mutex_);
  return malformed_;
}

}  // namespace esmc::host
