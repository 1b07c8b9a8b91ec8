/// Readers of what runs have left: what tests/fuzz/recording.cpp found, and what it rests on.

#include <gtest/gtest.h>

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>

#include "host_sim/error.hpp"
#include "host_sim/record/recording.hpp"
#include "host_sim/scene/scene.hpp"
#include "host_sim/version.hpp"

namespace esmc::host {
namespace {

/// A directory as `esmc plant` leaves one, of no ticks and one frame.
class RecordingFiles : public testing::Test {
 protected:
  RecordingFiles() {
    std::string path = (std::filesystem::temp_directory_path() / "recording_test.XXXXXX").string();
    EXPECT_NE(mkdtemp(path.data()), nullptr);
    path_ = path;
    write("scene.toml", "");
    write("log.csv", "t\n");
    write("frames.log", "(0000000000.000000) can0 123#00\n");
    write("frames.csv", "look,sent,age_us\n0,0,7\n");
    summary("0");
  }
  ~RecordingFiles() override { std::filesystem::remove_all(path_); }
  void write(const std::string& name, const std::string& text) const {
    std::ofstream(path_ + "/" + name, std::ios::binary) << text;
  }
  void summary(const std::string& ticks) const {
    write("summary.json", R"({"run": {"command": "plant", "version": ")" + std::string(version) +
                              R"(", "realtime": false, "scalar": "double", "scene_digest": ")" +
                              scene_digest(Scene{}) + R"("}, "seed": 1, "ticks": )" + ticks +
                              R"(, "bus": {"frames": 1, "lost": 0}})");
  }
  [[nodiscard]] Recording read() const { return read_recording(path_, false); }

  std::string path_;
};

TEST_F(RecordingFiles, AreRead) {
  const Recording r = read();
  EXPECT_EQ(r.ticks, 0U);
  const auto next = passed_frames(r);
  const auto p = next();
  ASSERT_TRUE(p);
  EXPECT_EQ(p->age_us, 7U);
  EXPECT_FALSE(next());
}

TEST_F(RecordingFiles, AnEmptyLogIsNotThatOfAllTicksThereAre) {
  write("log.csv", "");
  summary(std::to_string(std::numeric_limits<std::uint64_t>::max()));
  EXPECT_THROW((void)read(), InputError);
}

TEST_F(RecordingFiles, AFrameThatWasSentHasNotWaited) {
  write("frames.csv", "look,sent,age_us\n0,1,0\n");
  EXPECT_TRUE(passed_frames(read())());
  write("frames.csv", "look,sent,age_us\n0,1,7\n");
  EXPECT_THROW((void)passed_frames(read())(), InputError);
}

TEST(Candump, TimesHaveNoSign) {
  EXPECT_TRUE(parse_candump("(0000000000.000000) can0 123#00"));
  EXPECT_FALSE(parse_candump("(-000000000.000000) can0 123#00"));
  EXPECT_FALSE(parse_candump("(0000000000.-00000) can0 123#00"));
}

TEST(Candump, TheLengthOfARemoteFrameIsOneDigit) {
  EXPECT_TRUE(parse_candump("(0000000000.000000) can0 123#R8"));
  EXPECT_FALSE(parse_candump("(0000000000.000000) can0 123#R08"));
}

TEST(Tables, OfASpanThatNoDoubleHoldsAreNotEven) {
  RecordedTable even{"log.csv", {"t"}, {{-1e308, 0.0, 0.7e308}}, {}};
  EXPECT_NO_THROW(require_even(even, 0, ""));
  const RecordedTable span{"log.csv", {"t"}, {{-1e308, 0.0, 1.0, 1e308}}, {}};
  EXPECT_THROW(require_even(span, 0, ""), InputError);
}

}  // namespace
}  // namespace esmc::host
