#include "reconstruction/inspection/rig_fit.h"

#include <cmath>
#include <numbers>
#include <vector>

#include <gmock/gmock.h>

#include "core/quantile.h"
#include "reconstruction/inspection/pose_time_fit.h"
#include "reconstruction/datasets/rgbd_sequence.h"
#include "tests/reconstruction/rough_walk.h"
#include "tests/temporary_folder.h"

namespace segsim::reconstruction {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::RoughWalk;
using tests::TemporaryFolder;

/// Depth camera 2.5 cm to the right, 0.4 cm above and 0.3 cm behind, turned by 0.9 degrees.
CameraToCamera true_offset() {
  const double degree = std::numbers::pi / 180.0;
  return {glm::angleAxis(0.8 * degree, glm::dvec3(0, 1, 0)) *
              glm::angleAxis(-0.4 * degree, glm::dvec3(1, 0, 0)),
          {0.025, -0.004, -0.003}};
}

double turn_deg(const CameraToCamera& a, const CameraToCamera& b) {
  const glm::dquat q = glm::conjugate(a.rotation()) * b.rotation();
  return 2.0 * std::atan2(glm::length(glm::dvec3(q.x, q.y, q.z)), std::abs(q.w)) * 180.0 /
         std::numbers::pi;
}

SequenceOptions level() {
  SequenceOptions options;
  options.up_axis = UpAxis::kZ;
  options.floor_height_m = 0.0;
  return options;
}

TEST(RigFit, FindsWhereTheDepthCameraStands) {
  const TemporaryFolder folder("rig");
  RoughWalk walk;
  walk.T_color_depth = true_offset();
  walk.write(folder.path());
  const auto sequence = open_sequence(folder.path(), level());
  RigFitOptions options;
  const RigFit fit = fit_rig(*sequence, options);
  std::printf("%s\n%s\n", fit.text(options).c_str(), fit.doubt.c_str());
  const glm::dvec3 t = fit.offset.T_color_depth.translation_m();
  std::printf("%g %g %g cm, rot err %g deg\n", 100 * t.x, 100 * t.y, 100 * t.z,
              turn_deg(fit.offset.T_color_depth, true_offset()));
  EXPECT_THAT(fit.doubt, IsEmpty());
  EXPECT_TRUE(fit.is_off());
}

TEST(RigFit, TwoRegisteredCamerasAreLeftAlone) {
  const TemporaryFolder folder("rig");
  RoughWalk().write(folder.path());
  const auto sequence = open_sequence(folder.path(), level());
  RigFitOptions options;
  const RigFit fit = fit_rig(*sequence, options);
  std::printf("%s\n%s\n", fit.text(options).c_str(), fit.doubt.c_str());
  EXPECT_FALSE(fit.is_off());
}

TEST(RigFit, FindsHowLateDepthIs) {
  const TemporaryFolder folder("rig");
  RoughWalk walk;
  walk.depth_late_s = 0.032;
  walk.write(folder.path());
  const auto sequence = open_sequence(folder.path(), level());
  RigFitOptions options;
  options.fit_place = false, options.fit_time = options.use_times = true;
  const RigFit fit = fit_rig(*sequence, options);
  std::printf("%s\n%s\n", fit.text(options).c_str(), fit.doubt.c_str());
  options.fit_place = true;
  const RigFit both = fit_rig(*sequence, options);
  std::printf("%s\n%s\n", both.text(options).c_str(), both.doubt.c_str());
}

TEST(PoseTimeFit, FindsHowLatePosesAre) {
  const TemporaryFolder folder("rig");
  RoughWalk walk;
  walk.poses_late_s = -0.045;
  walk.write(folder.path());
  const auto sequence = open_sequence(folder.path(), level());
  const PoseTimeFit fit = fit_pose_time(*sequence);
  std::printf("%s\n%s %g %zu\n", fit.text().c_str(), fit.doubt.c_str(), fit.usual_px, fit.pairs);
}

}  // namespace
}  // namespace segsim::reconstruction
