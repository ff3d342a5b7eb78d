#include "reconstruction/lifting/cloud_start.h"

#include <algorithm>
#include <cmath>

#include <gmock/gmock.h>
#include <glm/geometric.hpp>

#include "tests/error_message.h"

namespace segsim::reconstruction {
namespace {

using tests::input_error_of;

constexpr double kBoardHeight_m = 0.5, kBoardHalf_m = 0.3, kFloorHalf_m = 1.0;
constexpr core::Rgb8 kLeft{200, 40, 30}, kRight{30, 60, 220}, kBoard{40, 180, 50};
constexpr float kStep_m = 0.01F;

/// A floor of two colours under a board of a third, seen from a circle of cameras; traced
/// exactly, without depth.
class BoardAboveFloor final : public RgbdSequence {
 public:
  /// The source's world lies this much beside ours.
  explicit BoardAboveFloor(const glm::dvec3& offset_m = glm::dvec3(0.0))
      : offset_m_(offset_m) {
    intrinsics_ = core::CameraIntrinsics::from_fov(160, 120, 1.2);
    for (int i = 0; i < 12; ++i) {
      const double angle = i * 2.0 * 3.14159265358979 / 12.0;
      poses_.push_back(
          core::look_at({1.6 * std::cos(angle), 1.6 * std::sin(angle), 1.5}, {0.0, 0.0, 0.1}));
    }
  }

  const std::string& name() const override { return name_; }
  const core::CameraIntrinsics& intrinsics() const override { return intrinsics_; }
  std::size_t frame_count() const override { return poses_.size(); }
  const std::string& frame_name(std::size_t) const override { return name_; }
  const core::CameraPose& pose(std::size_t i) const override { return poses_[i]; }
  core::Transform<core::frame::World, core::frame::World> T_world_source() const override {
    return {glm::dquat(1.0, 0.0, 0.0, 0.0), offset_m_};
  }
  bool has_depth() const override { return false; }
  bool has_masks() const override { return false; }
  const std::vector<core::SceneClass>& classes() const override { return classes_; }
  const std::vector<core::SceneInstance>& instances() const override { return instances_; }
  const std::vector<std::string>& warnings() const override { return lines_; }
  const std::vector<std::string>& notes() const override { return lines_; }

  RgbdFrame load(std::size_t i) const override {
    RgbdFrame frame;
    frame.name = name_;
    frame.T_world_camera = poses_[i];
    frame.rgb = core::Image<core::Rgb8>(intrinsics_.width_px, intrinsics_.height_px);
    const glm::dvec3 o = poses_[i].translation_m();
    for (int y = 0; y < intrinsics_.height_px; ++y) {
      for (int x = 0; x < intrinsics_.width_px; ++x) {
        const glm::dvec3 d =
            poses_[i].rotation() * intrinsics_.back_project({x + 0.5, y + 0.5}, 1.0);
        const glm::dvec3 board = o + d * ((kBoardHeight_m - o.z) / d.z);
        const glm::dvec3 floor = o + d * (-o.z / d.z);
        if (std::max(std::abs(board.x), std::abs(board.y)) < kBoardHalf_m) {
          frame.rgb(x, y) = kBoard;
        } else if (d.z < 0.0) {
          frame.rgb(x, y) = floor.x < 0.0 ? kLeft : kRight;
        }
      }
    }
    return frame;
  }

 private:
  glm::dvec3 offset_m_;
  std::string name_ = "board";
  core::CameraIntrinsics intrinsics_;
  std::vector<core::CameraPose> poses_;
  std::vector<core::SceneClass> classes_;
  std::vector<core::SceneInstance> instances_;
  std::vector<std::string> lines_;
};

PointCloud board_and_floor() {
  PointCloud cloud;
  const auto add = [&](double half_m, double z_m) {
    const int n = static_cast<int>(std::lround(half_m / kStep_m));
    for (int iy = -n; iy <= n; ++iy) {
      for (int ix = -n; ix <= n; ++ix) {
        cloud.position_m.emplace_back(static_cast<float>(ix) * kStep_m,
                                      static_cast<float>(iy) * kStep_m,
                                      static_cast<float>(z_m));
      }
    }
  };
  add(kFloorHalf_m, 0.0);
  add(kBoardHalf_m, kBoardHeight_m);
  return cloud;
}

LiftOptions coarse() {
  LiftOptions options;
  options.voxel_m = 0.03;
  options.threads = 2;
  return options;
}

glm::vec3 normal_of(const renderer::SurfelCloud& surfels, std::size_t i) {
  return surfels.R_world_surfel[i] * glm::vec3(0.0F, 0.0F, 1.0F);
}
glm::vec3 color_of(const renderer::SurfelCloud& surfels, std::size_t i) {
  return 0.5F + renderer::kShC0 * surfels.sh[i];
}
glm::vec3 color_of(const core::Rgb8& rgb) { return glm::vec3(rgb.r, rgb.g, rgb.b) / 255.0F; }

TEST(CloudStart, SurfelsLieInTheSurfaceAndFaceTheCameras) {
  const LiftResult start = start_from_cloud(board_and_floor(), BoardAboveFloor(), coarse());
  renderer::check_surfels(start.surfels);
  // One a voxel: the floor has 67 x 67 of them, the board 20 x 20, give or take borders.
  EXPECT_NEAR(static_cast<double>(start.surfels.size()), 67.0 * 67.0 + 20.0 * 20.0, 300.0);
  EXPECT_FALSE(start.surfels.has_labels());
  EXPECT_EQ(start.camera_positions_m.size(), 12U);
  for (std::size_t i = 0; i < start.surfels.size(); ++i) {
    const glm::vec3 p_m = start.surfels.position_m[i];
    EXPECT_LT(std::min(std::abs(p_m.z), std::abs(p_m.z - 0.5F)), 1e-4F);
    EXPECT_GT(normal_of(start.surfels, i).z, 0.999F) << p_m.x << " " << p_m.y << " " << p_m.z;
    EXPECT_GT(start.surfels.scale_m[i].x, 0.45F * 0.03F - 1e-6F);
    EXPECT_LT(start.surfels.scale_m[i].x, 1.1F * 0.03F);
  }
}

TEST(CloudStart, ColorsComeFromTheFramesThatSeeThePoint) {
  const LiftResult start = start_from_cloud(board_and_floor(), BoardAboveFloor(), coarse());
  int floor = 0, board = 0, floor_right = 0, board_right = 0;
  for (std::size_t i = 0; i < start.surfels.size(); ++i) {
    const glm::vec3 p_m = start.surfels.position_m[i];
    const glm::vec3 color = color_of(start.surfels, i);
    const double from_middle_m = std::max(std::abs(p_m.x), std::abs(p_m.y));
    if (p_m.z > 0.25F) {
      if (from_middle_m > kBoardHalf_m - 0.03) continue;  // Pixels of the border show both.
      ++board;
      board_right += glm::distance(color, color_of(kBoard)) < 0.05F ? 1 : 0;
    } else if (std::abs(p_m.x) > 0.04F) {
      ++floor;
      const core::Rgb8 truth = p_m.x < 0.0F ? kLeft : kRight;
      // What no camera sees, below the middle of the board, is grey.
      floor_right += glm::distance(color, color_of(truth)) < 0.05F ||
                             glm::distance(color, glm::vec3(0.5F)) < 0.01F
                         ? 1
                         : 0;
    }
  }
  EXPECT_GT(board, 250);
  EXPECT_EQ(board_right, board);
  // Without the depth test a ninth of the floor would look like the board.
  EXPECT_GT(floor_right, 0.985 * floor);
}

TEST(CloudStart, ColorsOfTheCloudStay) {
  PointCloud cloud = board_and_floor();
  cloud.rgb.assign(cloud.position_m.size(), core::Rgb8{10, 200, 90});
  const LiftResult start = start_from_cloud(cloud, BoardAboveFloor(), coarse());
  for (std::size_t i = 0; i < start.surfels.size(); ++i) {
    ASSERT_LT(glm::distance(color_of(start.surfels, i), color_of({10, 200, 90})), 0.01F);
  }
}

TEST(CloudStart, TheCloudGoesTheWayOfThePoses) {
  PointCloud moved = board_and_floor();
  for (glm::vec3& p_m : moved.position_m) p_m -= glm::vec3(3.0F, -6.0F, 9.0F);
  const LiftResult start = start_from_cloud(board_and_floor(), BoardAboveFloor(), coarse());
  const LiftResult other =
      start_from_cloud(moved, BoardAboveFloor({3.0, -6.0, 9.0}), coarse());
  EXPECT_NEAR(static_cast<double>(other.surfels.size()),
              static_cast<double>(start.surfels.size()), 200.0);
  for (const glm::vec3& p_m : other.surfels.position_m) {
    EXPECT_LT(std::min(std::abs(p_m.z), std::abs(p_m.z - 0.5F)), 1e-4F);
    EXPECT_LT(std::max(std::abs(p_m.x), std::abs(p_m.y)), 1.01F);
  }
}

TEST(CloudStart, ThreadsDoNotMatter) {
  LiftOptions one = coarse();
  one.threads = 1;
  const LiftResult a = start_from_cloud(board_and_floor(), BoardAboveFloor(), one);
  const LiftResult b = start_from_cloud(board_and_floor(), BoardAboveFloor(), coarse());
  EXPECT_EQ(a.surfels.position_m, b.surfels.position_m);
  EXPECT_EQ(a.surfels.R_world_surfel, b.surfels.R_world_surfel);
  EXPECT_EQ(a.surfels.sh, b.surfels.sh);
}

TEST(CloudStart, HeldOutFramesAreNotLookedAt) {
  LiftOptions options = coarse();
  options.held_out_every = 4;
  const LiftResult start = start_from_cloud(board_and_floor(), BoardAboveFloor(), options);
  EXPECT_EQ(start.camera_positions_m.size(), 9U);
  EXPECT_EQ(start.statistics.frames_held_out, 3U);
}

TEST(CloudStart, ACloudOfAnotherPlaceIsRefused) {
  PointCloud elsewhere = board_and_floor();
  for (glm::vec3& p_m : elsewhere.position_m) p_m.z += 50.0F;  // Above all cameras.
  EXPECT_THAT(
      input_error_of([&] { (void)start_from_cloud(elsewhere, BoardAboveFloor(), coarse()); }),
      ::testing::AllOf(::testing::HasSubstr("coordinates of the recording's poses"),
                       ::testing::HasSubstr("found 0 of")));
  PointCloud few;
  few.position_m = {{0, 0, 0}, {0.001F, 0, 0}};
  EXPECT_THAT(
      input_error_of([&] { (void)start_from_cloud(few, BoardAboveFloor(), coarse()); }),
      ::testing::HasSubstr("points in at least 4 voxels"));
}

}  // namespace
}  // namespace segsim::reconstruction
