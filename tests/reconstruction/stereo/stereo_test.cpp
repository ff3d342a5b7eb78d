// Depth by multi-view stereo: each step against a closed form, and all of it against the exact
// depth of a textured room.

#include <cstring>
#include <filesystem>

#include <gmock/gmock.h>

#include "reconstruction/stereo/depth_comparison.h"
#include "reconstruction/stereo/stereo_depth.h"
#include "renderer/files/exr_io.h"
#include "tests/error_message.h"
#include "tests/reconstruction/stereo_room.h"
#include "tests/temporary_folder.h"

namespace segsim::reconstruction {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::StereoRoom;
using tests::TemporaryFolder;

StereoOptions small() {
  StereoOptions options;
  options.width_px = 160;
  return options;
}

/// What estimate_depth() complains about.
std::string error_of(const RgbdSequence& sequence, const fs::path& folder,
                     const StereoOptions& options = small()) {
  return tests::input_error_of([&] { (void)estimate_depth(sequence, options, folder); });
}

bool same_bits(const fs::path& a, const fs::path& b) {
  const auto p = renderer::read_depth_exr(a), q = renderer::read_depth_exr(b);
  return p.size() == q.size() &&
         std::memcmp(p.data(), q.data(), p.size() * sizeof(float)) == 0;
}

TEST(DepthComparer, QuantilesAndCompletenessOfKnownErrors) {
  core::Image<float> measured_m(10, 10, 2.0F), estimated_m(10, 10, std::nanf(""));
  for (int x = 0; x < 10; ++x) {
    measured_m(x, 9) = std::nanf("");  // Does not count.
    for (int y = 0; y < 5; ++y) estimated_m(x, y) = 2.0F + 0.01F * static_cast<float>(x);
    estimated_m(x, 9) = 1.0F;
  }
  DepthComparer comparer;
  comparer.add(estimated_m, measured_m);
  const auto result = comparer.result();
  ASSERT_TRUE(result);
  EXPECT_EQ(result->measured, 90U);
  EXPECT_EQ(result->estimated, 50U);
  EXPECT_NEAR(result->median_m, 0.045, 0.0051);
  EXPECT_NEAR(result->high_m, 0.085, 0.0051);
  EXPECT_NEAR(result->median_share, 0.5 * result->median_m, 1e-6);
  EXPECT_DOUBLE_EQ(result->within_5_percent, 1.0);
  EXPECT_NEAR(result->completeness(), 50.0 / 90.0, 1e-12);
}

TEST(DepthComparer, NothingWithoutAMeasurement) {
  DepthComparer comparer;
  comparer.add(core::Image<float>(4, 4, 1.0F), core::Image<float>(4, 4, std::nanf("")));
  EXPECT_FALSE(comparer.result());
}

/// The whole way on one room; the folder is shared by the tests.
class StereoDepth : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    room_ = new StereoRoom;
    folder_ = new TemporaryFolder("stereo");
    report_ = estimate_depth(*room_, small(), folder_->path());
  }
  static void TearDownTestSuite() {
    delete folder_;
    delete room_;
  }
  static inline StereoRoom* room_ = nullptr;
  static inline TemporaryFolder* folder_ = nullptr;
  static inline StereoReport report_;
};

TEST_F(StereoDepth, FindsTheRoom) {
  EXPECT_EQ(report_.frames, 24U);
  EXPECT_EQ(report_.frames_matched, 24U);
  EXPECT_EQ(report_.frames_resumed, 0U);
  const auto found = compare_with_recorded(folder_->path(), *room_);
  ASSERT_TRUE(found);
  EXPECT_LT(found->median_share, 0.008);
  EXPECT_LT(found->high_share, 0.03);
  EXPECT_GT(found->within_5_percent, 0.93);
  EXPECT_GT(found->completeness(), 0.6);
  EXPECT_NEAR(found->completeness(), report_.known_share, 1e-6);  // All of it is measured.
}

TEST_F(StereoDepth, DoesNotDependOnTheNumberOfThreads) {
  StereoOptions options = small();
  options.threads = 1;
  const TemporaryFolder one;
  (void)estimate_depth(*room_, options, one.path());
  for (std::size_t i = 0; i < room_->frame_count(); ++i) {
    EXPECT_TRUE(same_bits(one / own_depth_name(i), *folder_ / own_depth_name(i))) << i;
  }
}

TEST_F(StereoDepth, GoesOnWhereItWasStopped) {
  const TemporaryFolder stopped;
  fs::copy(folder_->path(), stopped.path(), fs::copy_options::recursive);
  fs::remove(stopped / own_depth_name(3));
  fs::remove(stopped / ("inverse-" + own_depth_name(3)));
  std::ofstream(stopped / ("inverse-" + own_depth_name(7))) << "cut";
  const StereoReport report = estimate_depth(*room_, small(), stopped.path());
  EXPECT_EQ(report.frames_resumed, 22U);
  for (const std::size_t i : {0, 3, 7, 23}) {
    EXPECT_TRUE(same_bits(stopped / own_depth_name(i), *folder_ / own_depth_name(i))) << i;
  }
}

TEST_F(StereoDepth, OtherOptionsBeginAnew) {
  const TemporaryFolder other;
  fs::copy(folder_->path(), other.path(), fs::copy_options::recursive);
  StereoOptions options = small();
  options.held_out_every = 4;
  const StereoReport report = estimate_depth(*room_, options, other.path());
  EXPECT_EQ(report.frames, 18U);
  EXPECT_EQ(report.frames_resumed, 0U);
  EXPECT_FALSE(fs::exists(other / own_depth_name(4)));  // Held out: nothing is left of it.
  EXPECT_TRUE(fs::exists(other / own_depth_name(5)));
}

TEST_F(StereoDepth, TakesThePlaceOfTheRecordings) {
  const TemporaryFolder folder;
  room_->write_nerfstudio(folder / "recording");
  fs::copy(folder_->path(), folder / "depth", fs::copy_options::recursive);
  fs::remove(folder.path() / "depth" / own_depth_name(2));
  SequenceOptions options;
  options.floor_height_m = 0.0;
  options.depth_scale = 3.0;  // Of the recording's depth, which this is not.
  EXPECT_FALSE(open_sequence(folder / "recording", options)->has_depth());
  options.own_depth = folder / "depth";
  const auto sequence = open_sequence(folder / "recording", options);
  EXPECT_TRUE(sequence->has_depth());
  EXPECT_TRUE(sequence->load(2).depth_m.empty());
  const core::Image<float> own =
      renderer::read_depth_exr(folder.path() / "depth" / own_depth_name(1));
  const core::Image<float> loaded = sequence->load(1).depth_m;
  ASSERT_EQ(own.size(), loaded.size());
  for (std::size_t k = 0; k < own.size(); ++k) {
    if (own.pixels()[k] > 0.0F) {
      ASSERT_EQ(own.pixels()[k], loaded.pixels()[k]);
    }
  }
  options.own_depth.clear();
  options.ignore_depth = true;
  EXPECT_FALSE(open_sequence(folder / "recording", options)->has_depth());
}

TEST(Stereo, KnownPointsBoundTheDepth) {
  StereoRoom room(12);
  room.know_points(60);
  const TemporaryFolder folder;
  const StereoReport report = estimate_depth(room, small(), folder.path());
  float nearest = 100.0F, farthest = 0.0F;
  for (std::size_t i = 0; i < room.frame_count(); ++i) {
    const RgbdFrame frame = room.load(i);
    for (const float z : frame.depth_m.pixels()) {
      nearest = std::min(nearest, z), farthest = std::max(farthest, z);
    }
  }
  EXPECT_LT(report.near_m, nearest * 1.05);
  EXPECT_GT(report.near_m, 0.4 * nearest);
  EXPECT_GT(report.far_m, farthest);
  EXPECT_LT(report.far_m, 1.6 * farthest);
  const auto found = compare_with_recorded(folder.path(), room);
  ASSERT_TRUE(found);
  EXPECT_LT(found->median_share, 0.02);  // Half of the views: twice as far apart.
}

TEST(Stereo, ACameraThatOnlyTurnsIsRefused) {
  const TemporaryFolder folder;
  EXPECT_THAT(
      error_of(*StereoRoom::turning(), folder.path()),
      AllOf(HasSubstr("stereo room, poses: expected frames that show the same surfaces"),
            HasSubstr("found 0 of 24"), HasSubstr("only turns")));
}

TEST(Stereo, TwoFramesAreTooFew) {
  const TemporaryFolder folder;
  EXPECT_THAT(error_of(StereoRoom(2), folder.path()), HasSubstr("at least 3 frames"));
}

TEST(Stereo, PicturesThatDoNotFitTheirPosesAreRefused) {
  StereoRoom room(13);
  room.swap_poses(5);
  const TemporaryFolder folder;
  EXPECT_THAT(
      error_of(room, folder.path()),
      AllOf(HasSubstr("expected pictures that fit their poses"), HasSubstr("--invert-poses")));
}

}  // namespace
}  // namespace segsim::reconstruction
