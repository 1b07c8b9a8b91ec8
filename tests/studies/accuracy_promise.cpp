// Whether `esmc sim` keeps simulation.accuracy on random non-smooth scenes, judged by accuracy_judge.hpp.
// usage: accuracy_promise ESMC FIRST COUNT [SHOW]: scenes FIRST .. FIRST + COUNT - 1

#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/studies/accuracy_scenes.hpp"

namespace {

using judge::Case, judge::draw, judge::number, judge::scene;

struct Answer {
  int status = 0;
  judge::Vector q;
  bool fault = false;
  std::string text;  ///< of a refusal
};
Answer ask(const std::string& esmc, const std::string& file, const std::string& more) {
  Answer a;
  const std::string command = esmc + " sim " + file + " --json " + more + " 2>&1";
  std::FILE* pipe = ::popen(command.c_str(), "r");
  if (pipe == nullptr) std::abort();
  std::array<char, 4096> buffer{};
  for (std::size_t n = 0; (n = std::fread(buffer.data(), 1, buffer.size(), pipe)) > 0;)
    a.text.append(buffer.data(), n);
  a.status = WEXITSTATUS(::pclose(pipe));
  const auto json = nlohmann::json::parse(a.text, nullptr, false);
  if (json.is_discarded()) return a;
  a.q = json["final_state"]["q"].get<judge::Vector>();
  a.fault = !json["supervisor"]["faults"].empty();
  return a;
}

double distance(const judge::Vector& a, const judge::Vector& b) {
  if (a.size() != b.size() || a.empty()) return std::numeric_limits<double>::infinity();
  double d = 0;
  for (std::size_t i = 0; i < a.size(); ++i) d = std::max(d, std::abs(a[i] - b[i]));
  return d;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) return 2;
  const std::string esmc = argv[1];
  const auto first = std::strtoull(argv[2], nullptr, 10), count = std::strtoull(argv[3], nullptr, 10);
  const bool show = argc > 4;
  const std::string file = "accuracy_promise_" + std::to_string(::getpid()) + ".toml";
  constexpr std::array asked{1e-3, 1e-4, 1e-6};
  struct Totals {
    int well = 0, within = 0, outside = 0, refused = 0, ill = 0, ill_outside = 0;
  };
  std::array<Totals, asked.size()> totals;
  int faulty = 0;
  for (auto seed = first; seed < first + count; ++seed) {
    const Case c = draw(seed);
    std::ofstream(file) << scene(c);
    constexpr double step = 1e-4, tick = 1e-3;
    judge::Plant coarse(c), fine(c), other(c);
    const judge::Vector a = coarse.run(step, tick), b = fine.run(step / 2, tick);
    other.nudge(1e-10);
    const judge::Vector n = other.run(step / 2, tick);
    const double own = distance(a, b), sensitive = distance(n, b);
    std::string line;
    bool fault = false;
    for (std::size_t k = 0; k < asked.size(); ++k) {
      Totals& t = totals[k];
      const Answer answer = ask(esmc, file, "--set simulation.accuracy=" + number(asked[k]));
      fault = fault || answer.fault;
      if (answer.fault) continue;
      const bool well = own <= 0.1 * asked[k] && sensitive <= 0.1 * asked[k];
      const bool refused = answer.q.empty();
      const double error = refused ? 0.0 : distance(answer.q, b);
      (well ? t.well : t.ill)++;
      if (refused) {
        if (well) ++t.refused;
      } else if (error <= asked[k] + own) {
        if (well) ++t.within;
      } else {
        (well ? t.outside : t.ill_outside)++;
      }
      char text[200];
      std::snprintf(text, sizeof text, "  %g: %s %.1e", asked[k],
                    refused ? (answer.text.find("ill_posed") != std::string::npos ? "ill_posed" : "REFUSED")
                            : (error <= asked[k] + own ? "ok" : (well ? "OUTSIDE" : "outside")),
                    error);
      line += text;
      if (refused && show) line += " [" + answer.text.substr(0, answer.text.size() - 1) + "]";
    }
    faulty += fault ? 1 : 0;
    if (show) {
      std::printf("%llu %s %s%s%s%s%s%s own %.1e nudge %.1e events %ld%s%s\n",
                  static_cast<unsigned long long>(seed), c.five_bar ? "5R" : "RR",
                  c.closed ? "closed" : "open", c.rubs ? " friction" : "",
                  c.stops ? (c.soft ? " soft" : " rigid") : "", c.gear ? " gear" : "", c.play ? " play" : "",
                  c.load ? " load" : "", own, sensitive, fine.events(), fault ? " FAULT" : "", line.c_str());
      std::fflush(stdout);
    }
  }
  std::remove(file.c_str());
  bool good = true;
  for (std::size_t k = 0; k < asked.size(); ++k) {
    const Totals& t = totals[k];
    std::printf("asked %g: %d well-posed: %d within, %d outside, %d refused; %d others: %d outside\n",
                asked[k], t.well, t.within, t.outside, t.refused, t.ill, t.ill_outside);
    good = good && t.outside == 0 && 20 * t.refused <= t.well && t.well > 0;
  }
  std::printf("%d runs ended by a fault, not judged\n", faulty);
  return good ? 0 : 1;
}
