/// The controller as a program of a Linux computer. A supervisor computer arms it, signals end it.

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <utility>

#include "boards/capture.hpp"
#include "boards/linux/board.hpp"
#include "boards/linux/record.hpp"
#include "scene.hpp"

namespace {
using namespace esmc;

/// Number of signals: the first brings the mechanism to rest, the second takes the torque away.
volatile std::sig_atomic_t ended = 0;

constexpr std::uint64_t rest_ns = 5'000'000'000U;  ///< after which a requested halt becomes a stop
constexpr std::uint64_t idle_ns = 2'000'000'000U;  ///< then allowed for the drives to report idle

struct Options {
  const char* interface = nullptr;
  const char* record = nullptr;     ///< a row per tick
  const char* histogram = nullptr;  ///< microseconds of lateness, and of a tick
  const char* enable = nullptr;     ///< GPIO lines, "gpiochip0:17"
  const char* drive_enable = nullptr;
  const char* brake = nullptr;
  int priority = 80;
  bool best_effort = false;  ///< continue without fixed priority and locked memory
  std::uint64_t ticks = 0;   ///< 0: until a signal
};

[[noreturn]] void refuse(const char* why, const char* what) {
  std::fprintf(stderr, "esmc board: %s%s\n", why, what);
  std::exit(2);
}

long number(const char* name, const char* text, long least, long most) {
  char* end = nullptr;
  const long v = std::strtol(text, &end, 10);
  if (end == text || *end != '\0' || v < least || v > most) {
    std::fprintf(stderr, "esmc board: %s must be an integer from %ld to %ld, not '%s'\n", name, least, most,
                 text);
    std::exit(2);
  }
  return v;
}

[[noreturn]] void print_help() {
  std::puts(
      "usage: linux INTERFACE [--enable CHIP:LINE] [--drive-enable CHIP:LINE] [--brake CHIP:LINE] "
      "[--record FILE]\n"
      "             [--histogram FILE] [--priority 1..99] [--best-effort] [--ticks N]\n"
      "The scene that was baked into this program, on a CAN interface, until Ctrl-C. Armed by a "
      "supervisor computer.");
  std::exit(0);
}

Options read(int argc, char** argv) {
  constexpr std::pair<const char*, const char * Options::*> texts[] = {
      {"--record", &Options::record},
      {"--histogram", &Options::histogram},
      {"--enable", &Options::enable},
      {"--drive-enable", &Options::drive_enable},
      {"--brake", &Options::brake}};
  Options o;
  for (int i = 1; i < argc; ++i) {
    const char* a = argv[i];
    const auto is = [&](const char* name) { return std::strcmp(a, name) == 0; };
    const auto value = [&]() -> const char* {
      if (i + 1 >= argc) refuse("a value is missing behind ", a);
      return argv[++i];
    };
    const auto* const text =
        std::find_if(std::begin(texts), std::end(texts), [&](const auto& t) { return is(t.first); });
    if (is("--help")) {
      print_help();
    } else if (text != std::end(texts)) {
      o.*text->second = value();
    } else if (is("--priority")) {
      o.priority = static_cast<int>(number(a, value(), 1, 99));
    } else if (is("--ticks")) {
      o.ticks = static_cast<std::uint64_t>(number(a, value(), 1, 2'000'000'000));
    } else if (is("--best-effort")) {
      o.best_effort = true;
    } else if (a[0] == '-' || o.interface != nullptr) {
      refuse("unknown argument ", a);
    } else {
      o.interface = a;
    }
  }
  if (o.record != nullptr && o.histogram != nullptr && std::strcmp(o.record, o.histogram) == 0) {
    refuse("--record and --histogram are the same file: ", o.record);
  }
  if (o.interface == nullptr) refuse("which CAN interface? See --help", "");
  return o;
}

std::FILE* create(const char* path) {
  if (path == nullptr) return nullptr;
  std::FILE* f = std::fopen(path, "a");  // emptied when the run begins: it may be refused before
  if (f == nullptr) refuse("cannot write ", path);
  return f;
}

void wire(hal::GpioLine& line, const char* option, const char* place, hal::GpioLine::Use use) {
  if (place == nullptr) return;
  const std::error_code wrong = line.request(place, use, option + 2);  // without its dashes
  if (!wrong) return;
  std::fprintf(stderr, "esmc board: %s %s: %s; allowed is a free line of a chip, as gpiochip0:17\n", option,
               place, wrong.message().c_str());
  std::exit(2);
}

struct Row {
  TickResult<baked::Mechanism> result;
  Vec<baked::Scalar, baked::Mechanism::joints> angle;
  std::uint64_t tick = 0;
  std::uint32_t lateness_us = 0, tick_us = 0;
};

void write_row(std::FILE* f, const Row& r) {
  std::fprintf(f, "%.9g", static_cast<double>(r.tick) * 1e-9 * baked::period_ns);
  for (const auto v : {r.result.effector.x(), r.result.effector.y(), r.result.desired_effector.x(),
                       r.result.desired_effector.y()}) {
    std::fprintf(f, ",%.9g", static_cast<double>(v));
  }
  for (const auto v : r.angle) std::fprintf(f, ",%.9g", static_cast<double>(v));
  for (const auto v : r.result.torque) std::fprintf(f, ",%.9g", static_cast<double>(v));
  std::fprintf(f, ",%u,%u,%s,%s\n", r.lateness_us, r.tick_us, name(r.result.state), name(r.result.fault));
}

void write_header(std::FILE* f) {
  std::fputs("t,x,y,x_ref,y_ref", f);
  for (const char* what : {"angle", "torque"}) {
    for (int i = 1; i <= baked::Mechanism::joints; ++i) std::fprintf(f, ",%s_%d", what, i);
  }
  std::fputs(",lateness_us,tick_us,state,fault\n", f);
}

/// Locks the memory and fixes the priority; without `best_effort` a failure ends the program.
void require_realtime(const Options& o) {
  for (const auto& [what, code] : {std::pair{"no locked memory: ", hal::lock_memory()},
                                   std::pair{"no fixed priority: ", hal::fixed_priority(o.priority)}}) {
    if (!code) continue;
    if (!o.best_effort)
      refuse(what,
             (code.message() + " (as root, or see docs/boards.md; --best-effort goes on without)").c_str());
    std::fprintf(stderr, "esmc board: %s%s\n", what, code.message().c_str());
  }
}

using Loop = TimedLoop<baked::Node, LinuxBoard>;
struct Statistics {
  Histogram lateness, duration;
  std::uint64_t ticks = 0;
};

/// Runs until a signal or the last tick, then until the drives are idle. False: not idle in time.
bool run(baked::Node& node, Loop& loop, const hal::SocketCan& bus, const Options& o, Recorder<Row>& recorder,
         Statistics& s) {
  const hal::Alarm alarm;
  std::uint64_t asked_ns = 0;  // time of the request to end
  while (true) {
    const std::uint64_t now = hal::monotonic_ns();
    const auto left = static_cast<std::int32_t>(loop.instant_us() - static_cast<std::uint32_t>(now / 1000U));
    if (left > 0) alarm.wait((now / 1000U + static_cast<std::uint32_t>(left)) * 1000U, bus.descriptor());
    const std::uint64_t begin = hal::monotonic_ns();
    if (ended != 0) {
      if (asked_ns == 0) asked_ns = begin;
      node.command(ended > 1 || begin - asked_ns > rest_ns ? Command::stop : Command::halt);
    }
    const bool ticked = loop.turn([&](const TickResult<baked::Mechanism>& result) {
      const auto took = static_cast<std::uint32_t>((hal::monotonic_ns() - begin) / 1000U);
      s.lateness.add(loop.lateness_us());
      s.duration.add(took);
      recorder.push({result, node.sample().angle, s.ticks, loop.lateness_us(), took});
      ++s.ticks;
    });
    if (s.ticks == o.ticks && o.ticks != 0 && ended == 0) ended = 1;
    if (asked_ns == 0 || !ticked) continue;
    const State state = node.supervisor().state();
    const bool idle = (state == State::disabled || state == State::fault) && node.all_idle();
    if (idle || begin - asked_ns > rest_ns + idle_ns) return idle;
  }
}

/// Explicitly, for not every chip resets a line that is given back.
bool set_outputs_low(LinuxBoard& board) {
  bool complete = true;
  for (LinuxBoard::Output* out : {&board.drive_enable(), &board.brake()}) {
    int attempts = 100;
    while (!out->set(false) && --attempts > 0) {
    }
    if (attempts > 0) continue;
    std::fprintf(stderr, "esmc board: a GPIO output cannot be set low: %s\n", std::strerror(errno));
    complete = false;
  }
  return complete;
}

bool finish(std::FILE* f, const char* path) {
  const bool failed = std::ferror(f) != 0;
  if (std::fclose(f) == 0 && !failed) return true;
  std::fprintf(stderr, "esmc board: %s could not be written completely (disk full?)\n", path);
  return false;
}

void print_summary(const Statistics& s, const Loop& loop, const Recorder<Row>& recorder,
                   const Supervisor& supervisor) {
  std::printf(
      "{\"ticks\": %llu, \"late_ticks\": %u, \"lateness_us\": {\"p50\": %u, \"p99\": %u, \"max\": %u}, "
      "\"tick_us\": {\"p50\": %u, \"p99\": %u, \"max\": %u}, \"rows_lost\": %llu, \"state\": \"%s\", "
      "\"fault\": \"%s\"}\n",
      static_cast<unsigned long long>(s.ticks), loop.late(), s.lateness.quantile(0.5),
      s.lateness.quantile(0.99), s.lateness.most(), s.duration.quantile(0.5), s.duration.quantile(0.99),
      s.duration.most(), static_cast<unsigned long long>(recorder.lost()), name(supervisor.state()),
      name(supervisor.fault()));
}

}  // namespace

int main(int argc, char** argv) {
  static_assert(!baked::lockstep, "a board has its own time: bake with --realtime");
  static_assert(baked::armed_by_link,
                "a board is armed by a supervisor computer: command.arm = \"link\" in the scene");
  const Options o = read(argc, argv);
  std::error_code error;
  hal::SocketCan bus = hal::SocketCan::open(o.interface, error, baked::data_bitrate != 0);
  if (!bus.is_open()) refuse((std::string(o.interface) + ": ").c_str(), error.message().c_str());
  LinuxBoard board(bus);
  wire(board.enable(), "--enable", o.enable, hal::GpioLine::Use::contact);
  wire(board.drive_enable().line(), "--drive-enable", o.drive_enable, hal::GpioLine::Use::output);
  wire(board.brake().line(), "--brake", o.brake, hal::GpioLine::Use::output);
  std::FILE* const record = create(o.record);
  std::FILE* const histogram = create(o.histogram);
  Recorder<Row> recorder(record, write_row);  // its thread keeps the ordinary priority
  require_realtime(o);
  for (const auto& [f, path] : {std::pair{record, o.record}, std::pair{histogram, o.histogram}}) {
    if (f != nullptr && std::freopen(path, "w", f) == nullptr) refuse("cannot write ", path);
  }
  if (record != nullptr) write_header(record);
  for (const int s : {SIGINT, SIGTERM, SIGHUP, SIGQUIT}) std::signal(s, [](int) { ended = ended + 1; });

  const auto session = static_cast<std::uint8_t>(
      1U + std::chrono::system_clock::now().time_since_epoch().count() / 1'000'000 % 255);
  static baked::Node node(baked::config(session));
  keep_ticks(node);
  if (!bus.set_filters(node.filters()))
    refuse((std::string(o.interface) + ": ").c_str(), "refuses acceptance filters");
  Loop loop(node, board, baked::period_ns);
  static Statistics statistics;
  const bool idle = run(node, loop, bus, o, recorder, statistics);
  bool complete = set_outputs_low(board);
  recorder.close();
  if (record != nullptr) complete = finish(record, o.record) && complete;
  if (histogram != nullptr) {
    std::fputs("what,us,count\n", histogram);
    statistics.lateness.write(histogram, "lateness");
    statistics.duration.write(histogram, "tick");
    complete = finish(histogram, o.histogram) && complete;
  }
  print_summary(statistics, loop, recorder, node.supervisor());
  if (!idle) std::fprintf(stderr, "esmc board: ended although not every drive has said that it is idle\n");
  return node.supervisor().fault() == Fault::none && idle && complete ? 0 : 1;
}
