#include "reconstruction/lifting/lifting.h"

#include <algorithm>
#include <cmath>
#include <string>

#include <gmock/gmock.h>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>

#include "core/error.h"
#include "reconstruction/lifting/internal/voxel_fusion.h"
#include "renderer/cpu_renderer.h"

namespace segsim::reconstruction {
namespace {

constexpr double kSphereRadius_m = 0.4;
const glm::dvec3 kSphere_m{0.0, 0.0, 0.55};
constexpr int kFloorClass = 1, kBallClass = 2, kBallInstance = 31;

/// Faults that a test adds to the perfect depth.
struct Faults {
  bool flying_pixels = false;  ///< Silhouette pixels lie halfway between ball and floor.
  bool floater = false;        ///< One frame sees a board that is not there.
  double floor_hole_m = 0.0;   ///< Radius of a patch of floor without depth, at (0.9, 0, 0).
};

/// A ball above a checked floor, seen from a circle of cameras; traced exactly.
class BallOnFloor final : public RgbdSequence {
 public:
  explicit BallOnFloor(Faults faults = {}) : faults_(faults) {
    intrinsics_ = core::CameraIntrinsics::from_fov(240, 180, 1.2);
    for (int i = 0; i < 20; ++i) {
      const double angle = i * 2.0 * 3.14159265358979 / 20.0;
      const double height_m = i % 2 == 0 ? 1.3 : 0.7;
      poses_.push_back(core::look_at({1.7 * std::cos(angle), 1.7 * std::sin(angle), height_m},
                                     {0.0, 0.0, 0.35}));
    }
    classes_ = {{kFloorClass, "floor", false}, {kBallClass, "sports ball", true}};
    instances_ = {{kBallInstance, kBallClass, "ball 1"}, {32, kBallClass, "never seen"}};
  }

  const std::string& name() const override { return name_; }
  const core::CameraIntrinsics& intrinsics() const override { return intrinsics_; }
  std::size_t frame_count() const override { return poses_.size(); }
  const std::string& frame_name(std::size_t) const override { return name_; }
  const core::CameraPose& pose(std::size_t i) const override { return poses_[i]; }
  bool has_masks() const override { return true; }
  const std::vector<core::SceneClass>& classes() const override { return classes_; }
  const std::vector<core::SceneInstance>& instances() const override { return instances_; }
  const std::vector<std::string>& warnings() const override { return lines_; }
  const std::vector<std::string>& notes() const override { return lines_; }

  RgbdFrame load(std::size_t i) const override {
    const int width = intrinsics_.width_px, height = intrinsics_.height_px;
    RgbdFrame frame;
    frame.name = name_;
    frame.T_world_camera = poses_[i];
    frame.rgb = core::Image<core::Rgb8>(width, height);
    frame.depth_m = core::Image<float>(width, height, std::nanf(""));
    frame.semantic = core::Image<std::uint16_t>(width, height);
    frame.instance = core::Image<std::uint16_t>(width, height);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) trace(frame, x, y);
    }
    if (faults_.flying_pixels) add_flying_pixels(frame);
    if (faults_.floater && i == 6) {
      for (int y = 60; y < 120; ++y) {
        for (int x = 90; x < 150; ++x) frame.depth_m(x, y) = 0.8F;
      }
    }
    return frame;
  }

 private:
  void trace(RgbdFrame& frame, int x, int y) const {
    const glm::dvec3 ray = intrinsics_.back_project({x + 0.5, y + 0.5}, 1.0);
    const glm::dvec3 d = frame.T_world_camera.rotation() * ray;
    const glm::dvec3 o = frame.T_world_camera.translation_m();
    const glm::dvec3 oc = o - kSphere_m;
    const double a = glm::dot(d, d), b = glm::dot(oc, d);
    const double root = b * b - a * (glm::dot(oc, oc) - kSphereRadius_m * kSphereRadius_m);
    if (root > 0.0) {
      frame.depth_m(x, y) = static_cast<float>((-b - std::sqrt(root)) / a);
      frame.rgb(x, y) = {220, 40, 40};
      frame.semantic(x, y) = kBallClass;
      frame.instance(x, y) = kBallInstance;
      return;
    }
    if (!(d.z < 0.0)) return;
    const double z = -o.z / d.z;
    const glm::dvec3 p = o + z * d;
    // Behind a floater the other cameras must see something.
    const double half_m = faults_.floater ? 3.0 : 1.5;
    if (std::max(std::abs(p.x), std::abs(p.y)) > half_m) return;
    frame.rgb(x, y) = {40, 90, 200};
    frame.semantic(x, y) = kFloorClass;
    if (glm::length(p - glm::dvec3(0.9, 0.0, 0.0)) < faults_.floor_hole_m) return;
    frame.depth_m(x, y) = static_cast<float>(z);
  }

  static void add_flying_pixels(RgbdFrame& frame) {
    const core::Image<float> exact = frame.depth_m;
    for (int y = 1; y + 1 < exact.height_px(); ++y) {
      for (int x = 1; x + 1 < exact.width_px(); ++x) {
        const float left = exact(x - 1, y), right = exact(x + 1, y);
        if (std::abs(left - right) > 0.3F) frame.depth_m(x, y) = 0.5F * (left + right);
      }
    }
  }

  Faults faults_;
  std::string name_ = "ball";
  core::CameraIntrinsics intrinsics_;
  std::vector<core::CameraPose> poses_;
  std::vector<core::SceneClass> classes_;
  std::vector<core::SceneInstance> instances_;
  std::vector<std::string> lines_;
};

double ball_distance_m(const glm::vec3& p) {
  return std::abs(glm::length(glm::dvec3(p) - kSphere_m) - kSphereRadius_m);
}
double surface_distance_m(const glm::vec3& p) {
  return std::min(ball_distance_m(p), std::abs(static_cast<double>(p.z)));
}

/// Value below which the given share of the list lies.
double quantile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

TEST(Lifting, SurfelsLieOnTheSurfaceAndFaceOutwards) {
  const LiftResult result = lift(BallOnFloor{});
  renderer::check_surfels(result.surfels);
  std::vector<double> distance_m, angle_rad;
  for (std::size_t i = 0; i < result.surfels.size(); ++i) {
    const glm::vec3 p = result.surfels.position_m[i];
    const bool ball = ball_distance_m(p) < std::abs(p.z);
    const glm::vec3 expected =
        ball ? glm::normalize(p - glm::vec3(kSphere_m)) : glm::vec3(0, 0, 1);
    const glm::vec3 normal = glm::mat3_cast(result.surfels.R_world_surfel[i])[2];
    distance_m.push_back(surface_distance_m(p));
    angle_rad.push_back(std::acos(std::clamp(glm::dot(normal, expected), -1.0F, 1.0F)));
  }
  EXPECT_LT(quantile(distance_m, 0.5), 0.001);
  EXPECT_LT(quantile(distance_m, 0.99), 0.005);
  EXPECT_LT(quantile(angle_rad, 0.5), 0.03);
  EXPECT_LT(quantile(angle_rad, 0.97), 0.15);
  EXPECT_EQ(result.statistics.frames_used, 20U);
  EXPECT_EQ(result.camera_positions_m.size(), 20U);
}

TEST(Lifting, LabelsColorsAndBoxesFollowTheMasks) {
  const LiftResult result = lift(BallOnFloor{});
  std::size_t wrong = 0;
  for (std::size_t i = 0; i < result.surfels.size(); ++i) {
    const glm::vec3 p = result.surfels.position_m[i];
    const bool ball = ball_distance_m(p) < std::abs(p.z);
    const glm::vec3 color = 0.5F + renderer::kShC0 * result.surfels.sh[i];
    const bool right = result.surfels.semantic_id[i] == (ball ? kBallClass : kFloorClass) &&
                       result.surfels.instance_id[i] == (ball ? kBallInstance : 0) &&
                       (ball ? color.r > 0.7F : color.b > 0.6F);
    wrong += right ? 0 : 1;
  }
  EXPECT_LT(static_cast<double>(wrong), 0.005 * static_cast<double>(result.surfels.size()));
  EXPECT_GT(result.statistics.label_agreement, 0.98);
  ASSERT_EQ(result.instances.size(), 1U);  // The other one has no surfels.
  EXPECT_EQ(result.instances[0].name, "ball 1");
  for (int axis = 0; axis < 2; ++axis) {
    EXPECT_NEAR(result.instances[0].box_min_m[axis], -kSphereRadius_m, 0.02);
    EXPECT_NEAR(result.instances[0].box_max_m[axis], kSphereRadius_m, 0.02);
  }
}

TEST(Lifting, RenderedViewsHaveNoHoles) {
  const BallOnFloor sequence;
  LiftOptions options;
  options.held_out_every = 5;
  options.min_observations = 2;
  const LiftResult result = lift(sequence, options);
  EXPECT_EQ(result.statistics.frames_held_out, 4U);
  EXPECT_EQ(result.statistics.frames_used, 16U);
  const auto renderer = renderer::make_cpu_renderer(
      std::make_shared<renderer::SurfelCloud>(result.surfels), renderer::RenderOptions{});
  const core::Frame view =
      renderer->render(sequence.pose(5), sequence.intrinsics(), core::Channels::kAll);
  const RgbdFrame truth = sequence.load(5);  // Held out.
  std::size_t pixels = 0, holes = 0, off = 0;
  for (std::size_t k = 0; k < truth.depth_m.size(); ++k) {
    const float z = truth.depth_m.data()[k];
    if (!(z > 0.0F)) continue;
    const auto width = static_cast<std::size_t>(truth.depth_m.width_px());
    const core::Point<core::frame::Camera> seen{sequence.intrinsics().back_project(
        {static_cast<double>(k % width) + 0.5, static_cast<double>(k / width) + 0.5}, z)};
    const glm::dvec3 p = (truth.T_world_camera * seen).xyz_m;
    if (std::hypot(p.x, p.y) > 0.8)
      continue;  // The rim of the floor is seen from one side only.
    ++pixels;
    if (view.alpha.data()[k] < 0.8F) ++holes;
    if (!(std::abs(view.depth_m.data()[k] - z) < 0.03F)) ++off;
  }
  ASSERT_GT(pixels, 4000U);
  EXPECT_LT(static_cast<double>(holes), 0.002 * static_cast<double>(pixels));
  EXPECT_LT(static_cast<double>(off), 0.03 * static_cast<double>(pixels));  // Silhouette.
}

TEST(Lifting, DropsFlyingPixels) {
  const LiftResult result = lift(BallOnFloor{{.flying_pixels = true}});
  ASSERT_GT(result.surfels.size(), 500U);
  for (const glm::vec3& p : result.surfels.position_m) {
    ASSERT_LT(surface_distance_m(p), 0.03) << p.x << " " << p.y << " " << p.z;
  }
  EXPECT_GT(result.statistics.pixels_dropped, 500U);
}

TEST(Lifting, CarvesWhatOtherFramesSeeThrough) {
  const BallOnFloor sequence{{.floater = true}};
  const auto floating = [](const LiftResult& result) {
    return std::count_if(result.surfels.position_m.begin(), result.surfels.position_m.end(),
                         [](const glm::vec3& p) { return surface_distance_m(p) > 0.1; });
  };
  LiftOptions without;
  without.carve_frames = 0;
  const auto uncarved_count = floating(lift(sequence, without));
  const LiftResult carved = lift(sequence);
  EXPECT_GT(uncarved_count, 100);
  EXPECT_LT(floating(carved), uncarved_count / 3);
  EXPECT_GT(carved.statistics.voxels_carved, 50U);
}

TEST(Lifting, FillsSmallHolesInTheFloor) {
  const BallOnFloor sequence{{.floor_hole_m = 0.08}};
  const auto surfels_in_hole = [](const LiftResult& result) {
    return std::count_if(result.surfels.position_m.begin(), result.surfels.position_m.end(),
                         [](const glm::vec3& p) {
                           return glm::length(p - glm::vec3(0.9F, 0.0F, 0.0F)) < 0.05F;
                         });
  };
  LiftOptions without;
  without.fill_holes = false;
  EXPECT_EQ(surfels_in_hole(lift(sequence, without)), 0);
  const LiftResult filled = lift(sequence);
  EXPECT_GT(surfels_in_hole(filled), 10);
  for (std::size_t i = 0; i < filled.surfels.size(); ++i) {
    ASSERT_LT(surface_distance_m(filled.surfels.position_m[i]), 0.03);
  }
}

TEST(Lifting, IsTheSameForAnyNumberOfThreads) {
  const BallOnFloor sequence{{.flying_pixels = true, .floater = true}};
  LiftOptions one, four;
  one.threads = 1;
  four.threads = 4;
  const LiftResult a = lift(sequence, one), b = lift(sequence, four);
  EXPECT_EQ(a.surfels.position_m, b.surfels.position_m);
  EXPECT_EQ(a.surfels.scale_m, b.surfels.scale_m);
  EXPECT_EQ(a.surfels.sh, b.surfels.sh);
  EXPECT_EQ(a.surfels.semantic_id, b.surfels.semantic_id);
}

TEST(Lifting, RefusesASequenceWithoutUsableDepth) {
  LiftOptions options;
  options.max_depth_m = 0.3;
  EXPECT_THROW((void)lift(BallOnFloor{}, options), core::InputError);
}

TEST(VoxelFusion, KeysAreUniqueAndInvertible) {
  for (const glm::ivec3 cell :
       {glm::ivec3(0), glm::ivec3(-1, 5, 900000), glm::ivec3(7, -70000, 1)}) {
    EXPECT_EQ(internal::voxel_cell(internal::voxel_key(cell)), cell);
  }
  EXPECT_EQ(internal::voxel_cell(internal::voxel_key_at({-0.01F, 0.03F, 0.0F}, 0.02F)),
            glm::ivec3(-1, 1, 0));
}

TEST(VoxelFusion, VotesKeepAMajorityAmongManyLabels) {
  internal::LabelVotes votes;
  for (internal::LabelPair i = 0; i < 300; ++i) {
    votes.add(100 + i % 37, 1.0F);  // Noise: 37 labels.
    votes.add(7, 0.8F);
  }
  EXPECT_EQ(votes.label[votes.winner()], 7U);
  EXPECT_NEAR(votes.total, 540.0F, 0.1F);
}

}  // namespace
}  // namespace segsim::reconstruction
