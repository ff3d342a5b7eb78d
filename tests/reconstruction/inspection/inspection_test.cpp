#include "reconstruction/inspection/inspect_recording.h"

#include <atomic>
#include <cmath>
#include <functional>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "reconstruction/inspection/pose_hypotheses.h"
#include "tests/reconstruction/inspection/box_room_recording.h"

namespace segsim::reconstruction {
namespace {

using ::testing::AllOf;
using testing::BoxRoomRecording;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::vector<std::string> lines(const BoxRoomRecording& recording) {
  std::vector<std::string> result;
  for (const Finding& finding : inspect_recording(recording, sample_recording(recording))) {
    result.push_back(line_of(finding));
  }
  return result;
}

TEST(Inspection, ACleanRecordingHasNoFindings) {
  EXPECT_THAT(lines(BoxRoomRecording()), IsEmpty());
}

TEST(Inspection, InvertedPosesAreNamed) {
  BoxRoomRecording recording;
  recording.invert_poses();
  const auto findings = inspect_briefly(recording);
  ASSERT_EQ(findings.size(), 1U);
  EXPECT_TRUE(findings[0].defeats);
  EXPECT_THAT(lines(recording),
              ElementsAre(AllOf(HasSubstr("inverted poses: "), HasSubstr("--invert-poses"))));
}

TEST(Inspection, PosesInMillimetresAreNamed) {
  BoxRoomRecording recording;
  recording.scale_poses(1000.0);
  const auto findings = inspect_briefly(recording);
  ASSERT_EQ(findings.size(), 1U);
  EXPECT_TRUE(findings[0].defeats);
  EXPECT_THAT(line_of(findings[0]), HasSubstr("--pose-scale 0.001"));
}

TEST(Inspection, DepthInAnotherUnitIsNamed) {
  BoxRoomRecording five_thousandths;  // 5000 counts a metre, read as millimetres.
  five_thousandths.scale_depth(5.0);
  EXPECT_THAT(lines(five_thousandths),
              ElementsAre(AllOf(HasSubstr("wrong unit: "), HasSubstr("--depth-scale 0.2"))));
  BoxRoomRecording millimetres;  // Taken for metres.
  millimetres.scale_depth(1000.0);
  EXPECT_THAT(lines(millimetres), ElementsAre(HasSubstr("--depth-scale 0.001")));
}

TEST(Inspection, UnitsThatAreWrongTogetherAreNamed) {
  BoxRoomRecording recording;
  recording.scale_depth(1000.0);
  recording.scale_poses(1000.0);
  const auto findings = inspect_briefly(recording);
  ASSERT_EQ(findings.size(), 1U);
  EXPECT_FALSE(findings[0].defeats);
  EXPECT_THAT(line_of(findings[0]), HasSubstr("--depth-scale 0.001 --pose-scale 0.001"));
}

TEST(Inspection, InvertedPosesInMillimetresNeedBothFlags) {
  BoxRoomRecording recording;
  recording.scale_poses(1000.0);
  recording.invert_poses();
  EXPECT_THAT(lines(recording),
              ElementsAre(HasSubstr("--invert-poses"), HasSubstr("--pose-scale 0.001")));
}

TEST(Inspection, BlurIsNamedWithItsFrames) {
  BoxRoomRecording recording;
  recording.change_color = [](std::size_t i, cv::Mat& color) {
    if (i >= 20 && i < 24) cv::blur(color, color, {9, 1});
  };
  EXPECT_THAT(lines(recording), ElementsAre(AllOf(HasSubstr("motion blur: frames "),
                                                  HasSubstr("frame-000020 to frame-000023"))));
}

TEST(Inspection, HolesInDepthAreNamedWithTheirFrames) {
  BoxRoomRecording recording;
  recording.change_depth = [](std::size_t i, core::Image<float>& depth_m) {
    if (i != 30) return;
    for (std::size_t k = 0; k < depth_m.size() * 3 / 4; ++k) {
      depth_m.pixels()[k] = std::nanf("");
    }
  };
  EXPECT_THAT(lines(recording),
              ElementsAre(AllOf(HasSubstr("holes in depth: "), HasSubstr("frame-000030"))));
}

TEST(Inspection, DepthThatIsShiftedAgainstColourIsNamed) {
  BoxRoomRecording recording;
  recording.change_depth = [](std::size_t, core::Image<float>& depth_m) {
    const core::Image<float> before = depth_m;
    for (int y = 0; y < depth_m.height_px(); ++y) {
      for (int x = 0; x < depth_m.width_px(); ++x) {
        depth_m(x, y) = before(std::max(0, x - 5), y);
      }
    }
  };
  EXPECT_THAT(lines(recording),
              ::testing::Contains(
                  AllOf(HasSubstr("calibration: "), HasSubstr("shifted by (-5, 0) px"))));
}

TEST(Inspection, AFloorThatNoFrameSeesIsNamed) {
  BoxRoomRecording recording;
  recording.change_depth = [&](std::size_t i, core::Image<float>& depth_m) {
    recording.erase_below(i, 0.6, depth_m);
  };
  EXPECT_THAT(lines(recording), ::testing::Contains(AllOf(HasSubstr("floor unseen: "),
                                                          HasSubstr("--floor-height"))));
}

TEST(Inspection, DirectionsThatNoFrameLooksAtAreNamed) {
  BoxRoomRecording recording;
  recording.keep_only([](double yaw_deg) { return yaw_deg < 130.0 || yaw_deg > 290.0; });
  EXPECT_THAT(lines(recording), ::testing::Contains(HasSubstr("directions not looked at: ")));
}

TEST(Inspection, GapsAreNamedWithTheFrameBefore) {
  BoxRoomRecording recording;
  recording.erase(40, 52);
  EXPECT_THAT(lines(recording),
              ::testing::Contains(AllOf(HasSubstr("frame gap: "), HasSubstr("frame-000039"))));
}

TEST(Inspection, AFastCameraIsNamed) {
  BoxRoomRecording recording;
  recording.erase(40, 60);
  EXPECT_THAT(lines(recording), ::testing::Contains(AllOf(HasSubstr("fast camera: "),
                                                          HasSubstr("frame-000039"))));
  BoxRoomRecording timed;
  timed.frame_time_s = 0.02;  // 3 degrees a frame.
  EXPECT_THAT(lines(timed),
              ElementsAre(AllOf(HasSubstr("fast camera: "), HasSubstr("deg/s"))));
}

TEST(Inspection, RepeatedTimeStampsAreNamed) {
  BoxRoomRecording recording;
  recording.frame_time_s = 0.1;
  recording.repeated_time = 17;
  EXPECT_THAT(lines(recording),
              ElementsAre(AllOf(HasSubstr("repeated frames: "), HasSubstr("frame-000017"))));
}

TEST(Inspection, AnOpenLoopIsNamed) {
  BoxRoomRecording recording;
  recording.drift(0.6);
  EXPECT_THAT(lines(recording),
              ::testing::Contains(AllOf(HasSubstr("open loop: "), HasSubstr("m elsewhere"))));
}

TEST(Inspection, FewFramesAreNamed) {
  BoxRoomRecording recording;
  recording.erase(10, recording.frame_count());
  EXPECT_THAT(lines(recording), ::testing::Contains(HasSubstr("few frames: 10 frames")));
}

TEST(Inspection, OfAHundredThousandFramesFewAreRead) {
  BoxRoomRecording recording(100'000);
  const RecordingSample sample = sample_recording(recording);
  EXPECT_EQ(sample.path.size(), 100'000U);
  EXPECT_LE(recording.loads(), 1200U);
  EXPECT_LE(recording.most_at_once(), 64U);  // As many as threads, not as frames.
  EXPECT_EQ(sample.frames.size(), recording.loads());
}

TEST(Inspection, FramesAreNamedByRuns) {
  const BoxRoomRecording recording;
  EXPECT_EQ(frames_text(recording, {3}), "frame frame-000003");
  EXPECT_EQ(frames_text(recording, {3, 4, 5, 9}),
            "frames frame-000003 to frame-000005, frame-000009");
  EXPECT_THAT(frames_text(recording, {1, 3, 5, 7, 9, 11}), HasSubstr("and 2 more"));
}

}  // namespace
}  // namespace segsim::reconstruction
