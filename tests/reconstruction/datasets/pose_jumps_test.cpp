#include "reconstruction/datasets/internal/pose_jumps.h"

#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include <gmock/gmock.h>

#include "tests/error_message.h"
#include "tests/reconstruction/tiny_sequence.h"

namespace segsim::reconstruction {
namespace {

using internal::find_pose_jumps;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// A walk along x in steps of 5 cm.
std::vector<core::CameraPose> walk(int poses) {
  std::vector<core::CameraPose> path;
  for (int i = 0; i < poses; ++i) {
    path.emplace_back(glm::dquat(1.0, 0.0, 0.0, 0.0), glm::dvec3(0.05 * i, 0.0, 1.0));
  }
  return path;
}

core::CameraPose shifted(const core::CameraPose& pose, double y_m) {
  return {pose.rotation(), pose.translation_m() + glm::dvec3(0.0, y_m, 0.0)};
}

TEST(PoseJumps, LonePosesAndBreaksAreToldApart) {
  EXPECT_THAT(find_pose_jumps(walk(30)).lone, IsEmpty());
  EXPECT_THAT(find_pose_jumps(walk(30)).breaks, IsEmpty());
  std::vector<core::CameraPose> path = walk(30);
  path[7] = shifted(path[7], 1.2);
  for (std::size_t i = 20; i < path.size(); ++i) path[i] = shifted(path[i], -3.0);
  EXPECT_THAT(find_pose_jumps(path).lone, ElementsAre(7));
  EXPECT_THAT(find_pose_jumps(path).breaks, ElementsAre(19));
}

TEST(PoseJumps, TurnsCountToo) {
  std::vector<core::CameraPose> path = walk(30);
  const double half_rad = 0.5 * 1.3;
  path[12] = {glm::dquat(std::cos(half_rad), 0.0, 0.0, std::sin(half_rad)),
              path[12].translation_m()};
  EXPECT_THAT(find_pose_jumps(path).lone, ElementsAre(12));
}

TEST(PoseJumps, PhotographsAndQuickWalksHaveNone) {
  // Every fourth picture is taken elsewhere.
  std::vector<core::CameraPose> photographs = walk(40);
  for (std::size_t i = 0; i < photographs.size(); i += 4) {
    photographs[i] = shifted(photographs[i], 5.0);
  }
  EXPECT_THAT(find_pose_jumps(photographs).lone, IsEmpty());
  EXPECT_THAT(find_pose_jumps(photographs).breaks, IsEmpty());
  // Five pictures at each place, as captures of mesh worlds are.
  std::vector<core::CameraPose> places = walk(40);
  for (std::size_t i = 0; i < places.size(); ++i) {
    places[i] = shifted(places[i], 2.0 * static_cast<double>(i / 5));
  }
  EXPECT_THAT(find_pose_jumps(places).lone, IsEmpty());
  EXPECT_THAT(find_pose_jumps(places).breaks, IsEmpty());
  // Steps of 5 cm and one of 40 cm.
  std::vector<core::CameraPose> quick = walk(30);
  for (std::size_t i = 15; i < quick.size(); ++i) quick[i] = shifted(quick[i], 0.4);
  EXPECT_THAT(find_pose_jumps(quick).breaks, IsEmpty());
  std::vector<core::CameraPose> few = walk(7);
  few[3] = shifted(few[3], 9.0);
  EXPECT_THAT(find_pose_jumps(few).lone, IsEmpty());
}

/// As a recording on disk: frame 5 is elsewhere, and from frame 10 on all are.
void write_jumping(const std::filesystem::path& folder, bool lone) {
  for (int i = 0; i < 16; ++i) {
    char name[32];
    std::snprintf(name, sizeof name, "frame-%06d", i);
    const std::string stem = (folder / name).string();
    testing::write_images(stem + ".color.png", stem + ".depth.png");
    const double y_m = lone && i == 5 ? 2.0 : i >= 10 ? 4.0 : 0.0;
    testing::write_text(stem + ".pose.txt", testing::pose_line(0.05 * i, y_m, 3.0, "\n"));
  }
  testing::write_text(folder / "intrinsics.txt", "20 0 7.5\n0 21 5.5\n0 0 1\n");
}

TEST(PoseJumps, ARecordingWithALonePoseIsRefusedOrGoesWithoutIt) {
  const testing::TemporaryFolder folder("lone_pose");
  write_jumping(folder.path(), true);
  SequenceOptions options;
  options.floor_height_m = 0.0;
  EXPECT_THAT(
      tests::input_error_of([&] { (void)open_sequence(folder.path(), options); }),
      ::testing::AllOf(HasSubstr("pose of frame frame-000005"),
                       HasSubstr("expected one near those before and after, 0.10 m, 0 deg"),
                       HasSubstr("found a jump of 2.00 m, 0 deg and back")));
  options.on_bad_frame = OnBadFrame::kSkip;
  const auto sequence = open_sequence(folder.path(), options);
  EXPECT_EQ(sequence->frame_count(), 15U);
  EXPECT_EQ(sequence->frame_name(5), "frame-000006");
  EXPECT_THAT(sequence->warnings(),
              ElementsAre(HasSubstr("poses jump between frames frame-000009 and frame-000010: "
                                    "4.00 m"),
                          HasSubstr("frame frame-000005 skipped")));
}

TEST(PoseJumps, ABreakIsAWarning) {
  const testing::TemporaryFolder folder("break");
  write_jumping(folder.path(), false);
  SequenceOptions options;
  options.floor_height_m = 0.0;
  const auto sequence = open_sequence(folder.path(), options);
  EXPECT_EQ(sequence->frame_count(), 16U);
  EXPECT_THAT(sequence->warnings(), ElementsAre(HasSubstr("frame-000009 and frame-000010")));
}

}  // namespace
}  // namespace segsim::reconstruction
