// The parts of a live bench that have no loop: the queue between its threads, who may get in, what a page's
// changes become.

#include <gtest/gtest.h>

#include <set>
#include <thread>

#include "host_sim/error.hpp"
#include "host_sim/live/live_api.hpp"
#include "host_sim/live/session.hpp"
#include "host_sim/web/server.hpp"

namespace esmc::host {
namespace {

TEST(LiveRing, KeepsItsOrderAndRefusesWhatDoesNotFit) {
  Ring<std::string, 4> ring;
  std::string s;
  EXPECT_FALSE(ring.pop(s));
  for (int round = 0; round < 10; ++round) {
    for (const char* word : {"a", "b", "c", "d"}) EXPECT_TRUE(ring.push(word));
    s = "kept";
    EXPECT_FALSE(ring.push(std::move(s)));
    EXPECT_EQ(s, "kept");  // NOLINT(bugprone-use-after-move): that is the promise
    for (const char* word : {"a", "b", "c", "d"}) {
      ASSERT_TRUE(ring.pop(s));
      EXPECT_EQ(s, word);
    }
    EXPECT_FALSE(ring.pop(s));
  }
}

TEST(LiveRing, CarriesEveryValueFromOneThreadToAnother) {
  constexpr std::uint64_t many = 200'000;
  Ring<std::uint64_t, 64> ring;
  std::thread sender([&] {
    for (std::uint64_t n = 1; n <= many; ++n) {
      while (!ring.push(std::uint64_t(n))) std::this_thread::yield();
    }
  });
  std::uint64_t last = 0, got = 0;
  while (last < many) {
    if (!ring.pop(got)) {
      std::this_thread::yield();
      continue;
    }
    ASSERT_EQ(got, last + 1);
    last = got;
  }
  sender.join();
}

TEST(LiveAccess, TokensAreLongAndNeverTheSame) {
  std::set<std::string> seen;
  for (int i = 0; i < 100; ++i) {
    const std::string token = make_token();
    EXPECT_EQ(token.size(), 32U);
    EXPECT_EQ(token.find_first_not_of("0123456789abcdef"), std::string::npos);
    EXPECT_TRUE(seen.insert(token).second);
  }
  EXPECT_TRUE(same_token("0123", "0123"));
  for (const char* wrong : {"", "012", "01234", "0124", "1123"})
    EXPECT_FALSE(same_token(wrong, "0123")) << wrong;
  EXPECT_FALSE(same_token(std::string_view("0123\0", 5), "0123"));
}

TEST(LiveAccess, OnlyThisMachineByItsOwnNames) {
  for (const char* host : {"127.0.0.1:8000", "localhost:8000"}) {
    EXPECT_TRUE(own_host(host, 8000)) << host;
    EXPECT_TRUE(own_origin(std::string("http://") + host, 8000)) << host;
    EXPECT_FALSE(own_origin(std::string("https://") + host, 8000)) << host;
    EXPECT_FALSE(own_origin(host, 8000)) << host;
  }
  for (const char* host :
       {"", ":8000", "127.0.0.1", "127.0.0.1:", "127.0.0.1:80", "127.0.0.1:80001", "127.0.0.1:08000",
        "127.0.0.1:8000/", "evil.example:8000", "localhost.evil.example:8000", "127.0.0.1:8000:8000",
        "[::1]:8000", "LOCALHOST:8000 "}) {
    EXPECT_FALSE(own_host(host, 8000)) << host;
    EXPECT_FALSE(own_origin(std::string("http://") + host, 8000)) << host;
  }
  EXPECT_FALSE(own_origin("null", 8000));
}

TEST(LiveApi, ALaterSetOfAKeyStandsForTheEarlier) {
  std::vector<std::string> sets{"control.law=smc", "control.gain=1"};
  sets = with_set(std::move(sets), "control.law=pd");
  EXPECT_EQ(sets, (std::vector<std::string>{"control.gain=1", "control.law=pd"}));
  sets = with_set(std::move(sets), "nothing");
  EXPECT_EQ(sets.size(), 3U);
}

TEST(LiveApi, EffectsAsText) {
  const auto same = [](const std::string& toml, std::vector<std::pair<std::string, std::string>> wanted) {
    const auto got = effect_texts(toml);
    ASSERT_EQ(got.size(), wanted.size()) << toml;
    for (std::size_t i = 0; i < got.size(); ++i) {
      EXPECT_EQ(got[i].type, wanted[i].first);
      EXPECT_EQ(got[i].parameters, wanted[i].second);
    }
  };
  same("name = 'x'\n[control]\nlaw = 'pd'\n", {});
  same(
      "[[effects]]\nmass = 0.3\ntype = 'payload'\n\n[[effects]]\nbits = 12\ntype = "
      "'encoder'\n\n[limits]\ntype = 'no'\n",
      {{"payload", "mass = 0.3"}, {"encoder", "bits = 12"}});
  same(
      "effects = [{ from = 1.0, mass = 0.3, type = 'payload' }, { force = [1.0, 0.0], kind = 'pulse', to = "
      "2.0, type = 'external_force' }]\n",
      {{"payload", "from = 1.0, mass = 0.3"},
       {"external_force", "force = [1.0, 0.0], kind = 'pulse', to = 2.0"}});
  same("effects = [{ time_constant = 0.1, type = 'torque_lag', z = 1 }]\n",
       {{"torque_lag", "time_constant = 0.1, z = 1"}});
  same("effects = []\n", {});
}

}  // namespace
}  // namespace esmc::host
