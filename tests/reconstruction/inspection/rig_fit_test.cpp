// Offsets in space and time are found in a recorded walk, and taking them away makes depth and
// lifted surfels better. Tolerances are those that docs/datasets.md states.

#include "reconstruction/inspection/rig_fit.h"

#include <cmath>
#include <memory>
#include <numbers>
#include <vector>

#include <gmock/gmock.h>

#include "core/quantile.h"
#include "core/random.h"
#include "reconstruction/inspection/inspect_recording.h"
#include "reconstruction/inspection/pose_time_fit.h"
#include "reconstruction/lifting/lifting.h"
#include "renderer/cpu_renderer.h"
#include "tests/reconstruction/rough_walk.h"
#include "tests/temporary_folder.h"

namespace segsim::reconstruction {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::Each;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using testing::RoughWalk;
using tests::TemporaryFolder;

/// One flat for all tests: making it and its light takes seconds.
RoughWalk& the_walk() {
  static RoughWalk walk;
  walk.record_well();
  return walk;
}

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

RigFitOptions place_and_time(bool place, bool time) {
  RigFitOptions options;
  options.fit_place = place, options.fit_time = time, options.use_times = time;
  return options;
}

/// Share of depth pixels that are off by more than 3 % against the flat, over some frames.
double wrong_depth(const RoughWalk& walk, const RgbdSequence& sequence) {
  double wrong = 0.0, pixels = 0.0;
  for (std::size_t i = 3; i < sequence.frame_count(); i += 7) {
    const RgbdFrame frame = sequence.load(i);
    const int number = walk.number_at(*sequence.time_s(i));
    const core::Frame truth = walk.truth(number);
    for (std::size_t p = 0; p < truth.depth_m.size(); ++p) {
      const float found = frame.depth_m.pixels()[p], true_m = truth.depth_m.pixels()[p];
      if (!(found > 0.0F) || !(true_m > 0.0F)) continue;
      wrong += std::abs(found - true_m) > 0.03F * true_m ? 1.0 : 0.0;
      pixels += 1.0;
    }
  }
  return wrong / pixels;
}

struct Lifted {
  double psnr_db = 0.0, depth_error_m = 0.0;
};

/// Of lifted surfels against the flat, seen from between the recorded places: all pixels, and
/// the middle error of depth.
Lifted lifted_quality(const RoughWalk& walk, const RgbdSequence& sequence) {
  LiftOptions options;
  options.voxel_m = 0.03;
  const LiftResult lifted = lift(sequence, options);
  const auto renderer = renderer::make_cpu_renderer(
      std::make_shared<const renderer::SurfelCloud>(lifted.surfels));
  double squares = 0.0, values = 0.0;
  std::vector<double> errors_m;
  for (int k = 2; k + 2 < walk.frames; k += 6) {
    const core::CameraPose T = walk.pose(walk.time_s(k) + 0.5 * walk.frame_s);
    const core::Frame truth = walk.draw(T, RoughWalk::camera());
    const core::Frame drawn = renderer->render(T, RoughWalk::camera(), core::Channels::kRgbd);
    for (std::size_t p = 0; p < truth.rgb.size(); ++p) {
      const double error_m = drawn.depth_m.pixels()[p] - truth.depth_m.pixels()[p];
      if (!std::isnan(error_m)) errors_m.push_back(std::abs(error_m));
      const core::Rgb8 a = truth.rgb.pixels()[p], b = drawn.rgb.pixels()[p];
      for (const double d : {a.r - b.r, a.g - b.g, a.b - b.b}) squares += d * d, values += 1.0;
    }
  }
  return {10.0 * std::log10(255.0 * 255.0 * values / squares),
          core::quantile(errors_m, 0.5, core::Between::kNearest)};
}

struct Quality {
  double wrong_depth = 0.0, psnr_db = 0.0, depth_error_m = 0.0;
};
Quality quality(const RoughWalk& walk, const std::filesystem::path& folder,
                const SequenceOptions& options) {
  const auto sequence = open_sequence(folder, options);
  const Lifted lifted = lifted_quality(walk, *sequence);
  return {wrong_depth(walk, *sequence), lifted.psnr_db, lifted.depth_error_m};
}
void print(const char* what, const Quality& q) {
  std::printf("%s: %.2f %% of depth wrong; lifted: %.2f dB, depth off by %.1f mm\n", what,
              100.0 * q.wrong_depth, q.psnr_db, 1e3 * q.depth_error_m);
}

std::vector<std::string> findings(const RgbdSequence& sequence) {
  std::vector<std::string> lines;
  for (const Finding& finding : inspect_recording(sequence, sample_recording(sequence))) {
    lines.push_back(line_of(finding));
  }
  return lines;
}

TEST(RigFit, FindsWhereTheDepthCameraStands) {
  const TemporaryFolder folder("rig");
  RoughWalk& walk = the_walk();
  walk.T_color_depth = true_offset();
  walk.write(folder.path());
  const auto sequence = open_sequence(folder.path(), level());
  const RigFitOptions options = place_and_time(true, false);
  const RigFit fit = fit_rig(*sequence, options);
  std::printf("%s\n", fit.text(options).c_str());
  EXPECT_THAT(fit.doubt, IsEmpty());
  EXPECT_TRUE(fit.is_off());
  EXPECT_LT(
      glm::distance(fit.offset.T_color_depth.translation_m(), true_offset().translation_m()),
      0.006);
  EXPECT_LT(turn_deg(fit.offset.T_color_depth, true_offset()), 0.2);
  EXPECT_NEAR(fit.displacement_px, 5.7, 1.0);  // Of 320: 1.4 cm a metre, and 0.9 degrees.

  SequenceOptions found = level();
  found.color_depth = ColorDepth{fit.offset.T_color_depth, {}};
  SequenceOptions known = level();
  known.color_depth = ColorDepth{true_offset(), {}};
  const Quality as_is = quality(walk, folder.path(), level());
  const Quality better = quality(walk, folder.path(), found);
  const Quality best = quality(walk, folder.path(), known);
  print("as it is", as_is), print("found", better), print("known", best);
  EXPECT_LT(best.wrong_depth, 0.1 * as_is.wrong_depth);
  EXPECT_LT(better.wrong_depth, 0.1 * as_is.wrong_depth);
  EXPECT_LT(better.depth_error_m, 0.2 * as_is.depth_error_m);
  EXPECT_GT(better.psnr_db, as_is.psnr_db + 0.2);
  EXPECT_THAT(findings(*sequence), Contains(HasSubstr("--color-depth estimate")));
}

TEST(RigFit, LeavesRegisteredCamerasAlone) {
  const TemporaryFolder folder("rig");
  the_walk().write(folder.path());
  const auto sequence = open_sequence(folder.path(), level());
  for (const bool time : {false, true}) {
    const RigFitOptions options = place_and_time(!time, time);
    const RigFit fit = fit_rig(*sequence, options);
    EXPECT_FALSE(fit.is_off()) << fit.text(options);
    EXPECT_LT(fit.displacement_px, 0.6);
  }
  EXPECT_FALSE(fit_pose_time(*sequence).is_off());
  EXPECT_THAT(findings(*sequence),
              Each(AllOf(Not(HasSubstr("calibration")), Not(HasSubstr("clocks")))));
}

TEST(RigFit, FindsHowLateDepthIs) {
  const TemporaryFolder folder("rig");
  RoughWalk& walk = the_walk();
  walk.depth_late_s = 0.032;
  walk.write(folder.path());
  const auto sequence = open_sequence(folder.path(), level());
  const RigFit fit = fit_rig(*sequence, place_and_time(false, true));
  std::printf("%s\n", fit.text(place_and_time(false, true)).c_str());
  EXPECT_TRUE(fit.is_off()) << fit.doubt;
  EXPECT_NEAR(fit.offset.depth_time_s, 0.032, 0.002);

  SequenceOptions found = level();
  found.times.depth_offset_s = fit.offset.depth_time_s;
  const Quality as_is = quality(walk, folder.path(), level());
  const Quality better = quality(walk, folder.path(), found);
  print("as it is", as_is), print("found", better);
  EXPECT_LT(better.wrong_depth, 0.1 * as_is.wrong_depth);
  EXPECT_LT(better.depth_error_m, 0.3 * as_is.depth_error_m);
  EXPECT_THAT(findings(*sequence), Contains(HasSubstr("--depth-time-offset estimate")));
}

TEST(RigFit, FindsPlaceAndTimeTogether) {
  const TemporaryFolder folder("rig");
  RoughWalk& walk = the_walk();
  walk.T_color_depth = true_offset();
  walk.depth_late_s = -0.025;
  walk.write(folder.path());
  const auto sequence = open_sequence(folder.path(), level());
  const RigFit fit = fit_rig(*sequence, place_and_time(true, true));
  EXPECT_TRUE(fit.is_off()) << fit.doubt;
  EXPECT_NEAR(fit.offset.depth_time_s, -0.025, 0.003);
  EXPECT_LT(turn_deg(fit.offset.T_color_depth, true_offset()), 0.25);
  EXPECT_LT(
      glm::distance(fit.offset.T_color_depth.translation_m(), true_offset().translation_m()),
      0.008);
}

TEST(RigFit, RefusesWhatTellsNothing) {
  const TemporaryFolder folder("rig");
  RoughWalk& walk = the_walk();
  // Depth of other places: its contours have nothing to do with the pictures.
  walk.change_depth = [&](int frame, core::Image<float>& depth_m) {
    depth_m = walk.truth((frame * 17 + 23) % walk.frames).depth_m;
  };
  walk.write(folder.path());
  const auto sequence = open_sequence(folder.path(), level());
  const RigFit fit = fit_rig(*sequence, place_and_time(true, false));
  EXPECT_THAT(fit.doubt, Not(IsEmpty())) << fit.text(place_and_time(true, false));
  EXPECT_FALSE(fit.is_off());
  // A bare wall has no contours.
  const TemporaryFolder bare("rig");
  walk.change_depth = [](int, core::Image<float>& depth_m) {
    for (float& z : depth_m.pixels()) z = 2.0F;
  };
  walk.write(bare.path());
  const RigFit none =
      fit_rig(*open_sequence(bare.path(), level()), place_and_time(true, false));
  EXPECT_THAT(none.doubt, HasSubstr("too little to go by"));
}

TEST(PoseTimeFit, FindsHowLatePosesAre) {
  const TemporaryFolder folder("rig");
  RoughWalk& walk = the_walk();
  walk.poses_late_s = -0.045;
  walk.write(folder.path());
  const auto sequence = open_sequence(folder.path(), level());
  const PoseTimeFit fit = fit_pose_time(*sequence);
  std::printf("%s\n", fit.text().c_str());
  EXPECT_TRUE(fit.is_off()) << fit.doubt;
  EXPECT_NEAR(fit.offset_s, -0.045, 0.005);

  SequenceOptions found = level();
  found.times.pose_offset_s = fit.offset_s;
  const Quality as_is = quality(walk, folder.path(), level());
  const Quality better = quality(walk, folder.path(), found);
  print("as it is", as_is), print("found", better);
  EXPECT_LT(better.depth_error_m, 0.2 * as_is.depth_error_m);
  EXPECT_GT(better.psnr_db, as_is.psnr_db + 0.5);
  EXPECT_THAT(findings(*sequence), Contains(HasSubstr("--pose-time-offset estimate")));
}

TEST(RollingShutter, PicturesAreStraightened) {
  const TemporaryFolder folder("rig");
  RoughWalk& walk = the_walk();
  walk.read_out_s = 0.03;
  walk.write(folder.path());
  const auto differences = [&](const SequenceOptions& options) {
    const auto sequence = open_sequence(folder.path(), options);
    double sum = 0.0, count = 0.0;
    for (std::size_t i = 4; i < sequence->frame_count(); i += 9) {
      const RgbdFrame frame = sequence->load(i);
      const core::Frame truth = walk.truth(walk.number_at(*sequence->time_s(i)));
      for (std::size_t p = 0; p < truth.rgb.size(); ++p) {
        if (!frame.valid.empty() && frame.valid.pixels()[p] == 0) continue;
        const core::Rgb8 a = frame.rgb.pixels()[p], b = truth.rgb.pixels()[p];
        sum += std::abs(a.g - b.g), count += 1.0;
      }
    }
    EXPECT_GT(count, 0.9 * 320 * 240 * 6);
    return sum / count;
  };
  SequenceOptions straight = level();
  straight.times.read_out_s = walk.read_out_s;
  const double as_is = differences(level()), better = differences(straight);
  std::printf("grey levels off: %.2f, straightened %.2f\n", as_is, better);
  EXPECT_LT(better, 0.5 * as_is);
}

TEST(DepthSensor, WeightsOfTheSensorMakeBetterSurfaces) {
  const TemporaryFolder folder("rig");
  RoughWalk& walk = the_walk();
  core::RandomStream random(5, "depth");
  // Far depth is worth little.
  walk.change_depth = [&](int, core::Image<float>& depth_m) {
    for (float& z : depth_m.pixels()) {
      z += depth_sigma_m(DepthSensor::kStereo, z) * static_cast<float>(random.normal());
    }
  };
  walk.write(folder.path());
  SequenceOptions stated = level();
  stated.sensor = DepthSensor::kStereo;
  const Quality as_is = quality(walk, folder.path(), level());
  const Quality better = quality(walk, folder.path(), stated);
  print("as it is", as_is), print("stereo", better);
  EXPECT_LT(better.depth_error_m, as_is.depth_error_m);
}

}  // namespace
}  // namespace segsim::reconstruction
