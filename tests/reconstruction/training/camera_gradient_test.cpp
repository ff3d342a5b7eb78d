/// @file
/// The camera's derivatives, from the surfels', against differences of drawn images, in double
/// precision; and what poses do with them.

#include "reconstruction/training/internal/pose_gradient.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <vector>

#include <gmock/gmock.h>
#include <glm/geometric.hpp>

#include "core/error.h"
#include "core/random.h"
#include "reconstruction/training/internal/training_poses.h"
#include "reconstruction/training/pose_alignment.h"
#include "tests/reconstruction/training/finite_differences.h"
#include "tests/reconstruction/training/training_surfels.h"
#include "tests/temporary_folder.h"

namespace segsim::reconstruction {
namespace {

using testing::OwnedGradients;
using testing::OwnedImages;
using testing::OwnedSurfels;

const core::CameraIntrinsics kCamera{26, 21, 24.0, 23.0, 12.7, 10.4};

/// A linear loss of all images; normals are compared in the camera's axes, as a normal of a
/// depth image is.
class PoseLoss {
 public:
  explicit PoseLoss(OwnedSurfels<double> surfels)
      : surfels_(std::move(surfels)), slopes_(testing::random_loss<double>(3, kCamera)) {
    for (auto* plane : {&slopes_.rgb, &slopes_.depth_m, &slopes_.alpha, &slopes_.normal}) {
      for (double& value : *plane) value *= static_cast<double>(slopes_.area());
    }
  }

  double at(const core::CameraPose& pose) {
    OwnedImages<double> images(kCamera);
    rasterizer_->forward(surfels_.view(), kCamera, pose, images.view(), nullptr);
    const OwnedImages<double> slopes = in_world(pose);
    double sum = 0.0;
    const auto add = [&](const std::vector<double>& a, const std::vector<double>& b) {
      for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
    };
    add(images.rgb, slopes.rgb);
    add(images.depth_m, slopes.depth_m);
    add(images.alpha, slopes.alpha);
    add(images.normal, slopes.normal);
    return sum;
  }

  internal::CameraGradient gradient(const core::CameraPose& pose) {
    (void)at(pose);
    OwnedImages<double> slopes = in_world(pose);
    std::fill(slopes.distortion.begin(), slopes.distortion.end(), 0.0);
    OwnedGradients<double> by(surfels_);
    rasterizer_->backward(surfels_.view(), slopes.const_view(), by.view());
    const auto tensors = [&](const auto& s) {
      const std::int64_t n = surfels_.count();
      return internal::SurfelTensors{
          testing::tensor_of(s.position_m, {n, 3}), testing::tensor_of(s.log_scale, {n, 2}),
          testing::tensor_of(s.rotation, {n, 4}), testing::tensor_of(s.opacity_logit, {n}),
          testing::tensor_of(s.sh, {n, -1, 3})};
    };
    return internal::camera_gradient(tensors(surfels_), tensors(by), pose);
  }

 private:
  [[nodiscard]] OwnedImages<double> in_world(const core::CameraPose& pose) const {
    OwnedImages<double> slopes = slopes_;
    for (std::size_t i = 0; i < slopes.normal.size(); i += 3) {
      const double* n = slopes_.normal.data() + i;
      const glm::dvec3 turned = pose.rotation() * glm::dvec3(n[0], n[1], n[2]);
      for (int k = 0; k < 3; ++k) slopes.normal[i + static_cast<std::size_t>(k)] = turned[k];
    }
    return slopes;
  }

  OwnedSurfels<double> surfels_;
  OwnedImages<double> slopes_;
  std::unique_ptr<DifferentiableRasterizer<double>> rasterizer_ =
      make_cpu_rasterizer<double>({1});
};

void expect_differences(PoseLoss& loss, const core::CameraPose& pose) {
  constexpr double kStep = 1e-6;
  const internal::CameraGradient gradient = loss.gradient(pose);
  double largest = 0.0;
  for (int axis = 0; axis < 3; ++axis) {
    glm::dvec3 step(0.0);
    step[axis] = kStep;
    const glm::dvec3 none(0.0);
    const auto difference = [&](const glm::dvec3& m, const glm::dvec3& rad) {
      return (loss.at(internal::moved(pose, m, rad)) -
              loss.at(internal::moved(pose, -m, -rad))) /
             (2.0 * kStep);
    };
    const double by_m = difference(step, none), by_rad = difference(none, step);
    const auto k = static_cast<std::size_t>(axis);
    EXPECT_NEAR(gradient.translation[k], by_m, 1e-5 * (1.0 + std::abs(by_m))) << axis;
    EXPECT_NEAR(gradient.rotation[k], by_rad, 1e-5 * (1.0 + std::abs(by_rad))) << axis;
    largest = std::max({largest, std::abs(by_m), std::abs(by_rad)});
  }
  EXPECT_GT(largest, 1.0);
}

TEST(CameraGradient, MatchesDifferencesForEveryDegree) {
  for (int degree = 0; degree <= 3; ++degree) {
    SCOPED_TRACE("degree " + std::to_string(degree));
    PoseLoss loss(
        testing::random_surfels<double>(11 + static_cast<std::uint64_t>(degree), 14, degree));
    // Near where the surfels are before the camera; turned, so that axes are told apart.
    expect_differences(
        loss, {glm::normalize(glm::dquat(0.98, 0.03, -0.04, 0.2)), {0.05, -0.04, -0.1}});
  }
}

TEST(CameraGradient, MatchesDifferencesUnderTheLowPassAndTheClamp) {
  PoseLoss low_pass(testing::low_pass_surfels<double>());
  expect_differences(low_pass, {});
  PoseLoss opaque(testing::opaque_surfels<double>());
  expect_differences(opaque, {});
}

std::vector<core::CameraPose> ring() {
  std::vector<core::CameraPose> poses;
  for (int i = 0; i < 9; ++i) {
    poses.push_back(core::look_at({2.0 * std::cos(0.7 * i), 2.0 * std::sin(0.7 * i), 1.0},
                                  {0.1, 0.2, 0.3}));
  }
  return poses;
}

TEST(TrainingPoses, FirstStepIsAlongTheGradientInTheCameraAxes) {
  const std::vector<core::CameraPose> recorded = ring();
  internal::TrainingPoses poses(recorded);
  poses.step(3, {{2.0, -5.0, 0.0}, {0.0, 0.0, -4.0}}, 1e-3, 2e-3);
  const auto T_old_new = recorded[3].inverse() * poses.now()[3];
  EXPECT_NEAR(T_old_new.translation_m().x, -1e-3, 1e-9);
  EXPECT_NEAR(T_old_new.translation_m().y, 1e-3, 1e-9);
  EXPECT_NEAR(T_old_new.translation_m().z, 0.0, 1e-9);
  EXPECT_NEAR(2.0 * T_old_new.rotation().z, 2e-3, 1e-8);
  EXPECT_NEAR(T_old_new.rotation().x, 0.0, 1e-12);
  EXPECT_EQ(poses.now()[2].translation_m(), recorded[2].translation_m());
}

TEST(TrainingPoses, MeanStaysWhereItWas) {
  const std::vector<core::CameraPose> recorded = ring();
  internal::TrainingPoses poses(recorded);
  core::RandomStream random(4, "poses");
  for (int round = 0; round < 30; ++round) {
    internal::CameraGradient gradient;
    for (std::size_t k = 0; k < 3; ++k) {
      gradient.translation[k] = random.normal();
      gradient.rotation[k] = random.normal();
    }
    poses.step(static_cast<std::size_t>(round) % recorded.size(), gradient, 2e-3, 2e-3);
    poses.keep_mean();
  }
  glm::dvec3 shift_m(0.0), turn(0.0);
  for (std::size_t i = 0; i < recorded.size(); ++i) {
    shift_m += poses.now()[i].translation_m() - recorded[i].translation_m();
    const glm::dquat q = poses.now()[i].rotation() * glm::conjugate(recorded[i].rotation());
    turn += glm::dvec3(q.x, q.y, q.z);
  }
  EXPECT_LT(glm::length(shift_m), 1e-12);
  EXPECT_LT(glm::length(turn), 1e-6);
  EXPECT_GT(pose_change(recorded, poses.now()).mean_m, 1e-3);
}

TEST(TrainingPoses, StateComesBack) {
  const tests::TemporaryFolder folder("training_poses");
  internal::TrainingPoses poses(ring());
  poses.step(1, {{1.0, 2.0, 3.0}, {-1.0, 0.5, 2.0}}, 1e-3, 1e-3);
  poses.step(1, {{1.0, -2.0, 3.0}, {-1.0, 0.5, 2.0}}, 1e-3, 1e-3);
  internal::StateWriter out("poses");
  poses.save(out);
  out.write(folder.path() / "state");
  internal::TrainingPoses back(ring());
  const internal::StateReader in(folder.path() / "state", "poses");
  back.load(in);
  for (internal::TrainingPoses* p : {&poses, &back}) {
    p->step(1, {{0.3, 0.2, 0.1}, {0.1, 0.1, 0.1}}, 1e-3, 1e-3);
  }
  for (std::size_t i = 0; i < back.now().size(); ++i) {
    EXPECT_EQ(back.now()[i].translation_m(), poses.now()[i].translation_m());
    EXPECT_EQ(back.now()[i].rotation(), poses.now()[i].rotation());
  }
  std::vector<core::CameraPose> fewer = ring();
  fewer.pop_back();
  internal::TrainingPoses other(fewer);
  EXPECT_THROW(other.load(in), core::InputError);
}

TEST(PoseChange, MeansAndLargest) {
  const std::vector<core::CameraPose> from(2);
  const std::vector<core::CameraPose> to{
      {glm::dquat(1.0, 0.0, 0.0, 0.0), {0.03, 0.04, 0.0}},
      {glm::dquat(std::cos(0.1), 0.0, std::sin(0.1), 0.0), {0.0, 0.0, 0.0}}};
  const PoseChange change = pose_change(from, to);
  EXPECT_NEAR(change.mean_m, 0.025, 1e-12);
  EXPECT_NEAR(change.largest_m, 0.05, 1e-12);
  EXPECT_NEAR(change.mean_rad, 0.1, 1e-12);
  EXPECT_NEAR(change.largest_rad, 0.2, 1e-12);
}

}  // namespace
}  // namespace segsim::reconstruction
