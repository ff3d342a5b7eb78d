#include "core/frames.h"

#include <type_traits>

#include <gtest/gtest.h>

#include "core/camera.h"
#include "core/check.h"

namespace segsim::core {
namespace {

using frame::Camera;
using frame::Robot;
using frame::World;

template <class A, class B, class = void>
struct Composes : std::false_type {};
template <class A, class B>
struct Composes<A, B, std::void_t<decltype(std::declval<A>() * std::declval<B>())>>
    : std::true_type {};

static_assert(Composes<Transform<World, Robot>, Transform<Robot, Camera>>::value);
static_assert(!Composes<Transform<World, Camera>, Transform<World, Robot>>::value);
static_assert(!Composes<Transform<World, Camera>, Point<World>>::value);

void expect_near(const glm::dvec3& a, const glm::dvec3& b, double tolerance) {
  EXPECT_NEAR(a.x, b.x, tolerance);
  EXPECT_NEAR(a.y, b.y, tolerance);
  EXPECT_NEAR(a.z, b.z, tolerance);
}

TEST(Transform, CarriesTheOpticalAxisToTheRobotsForwardAxis) {
  const Transform<Robot, Camera> T_robot_camera = mast_camera(0.5, 0.0, 0.2);
  expect_near((T_robot_camera * Point<Camera>{{0.0, 0.0, 2.0}}).xyz_m, {2.2, 0.0, 0.5}, 1e-12);
  expect_near((T_robot_camera * Point<Camera>{{1.0, 0.0, 0.0}}).xyz_m, {0.2, -1.0, 0.5},
              1e-12);
  expect_near((T_robot_camera * Point<Camera>{{0.0, 1.0, 0.0}}).xyz_m, {0.2, 0.0, -0.5},
              1e-12);
}

TEST(Transform, PitchDownLowersTheOpticalAxis) {
  const Transform<Robot, Camera> T_robot_camera = mast_camera(1.0, 0.3);
  const glm::dvec3 p = (T_robot_camera * Point<Camera>{{0.0, 0.0, 1.0}}).xyz_m;
  expect_near(p, {std::cos(0.3), 0.0, 1.0 - std::sin(0.3)}, 1e-12);
}

TEST(Transform, InverseUndoesIt) {
  const CameraPose T_world_camera = look_at({1.0, -2.0, 1.5}, {3.0, 4.0, 0.5});
  const Point<Camera> p{{0.3, -0.7, 2.0}};
  expect_near((T_world_camera.inverse() * (T_world_camera * p)).xyz_m, p.xyz_m, 1e-12);
}

TEST(LookAt, PutsTheTargetOnTheOpticalAxisWithTheImageUpright) {
  const glm::dvec3 eye(1.0, -2.0, 1.5);
  const glm::dvec3 target(3.0, 4.0, 0.5);
  const CameraPose T_world_camera = look_at(eye, target);
  const glm::dvec3 in_camera = (T_world_camera.inverse() * Point<World>{target}).xyz_m;
  expect_near(in_camera, {0.0, 0.0, glm::length(target - eye)}, 1e-12);
  // A point above the target appears higher in the image: smaller y.
  const glm::dvec3 above =
      (T_world_camera.inverse() * Point<World>{target + glm::dvec3(0, 0, 1)}).xyz_m;
  EXPECT_LT(above.y, 0.0);
  EXPECT_NEAR(above.x, 0.0, 1e-12);
}

TEST(LookAt, RefusesCoincidingPoints) {
  EXPECT_THROW((void)look_at({1, 2, 3}, {1, 2, 3}), ContractViolation);
}

TEST(WrapAngle, BringsAnglesIntoTheHalfOpenTurn) {
  constexpr double kPi = 3.14159265358979323846;
  EXPECT_NEAR(wrap_angle_rad(3.0 * kPi / 2.0), -kPi / 2.0, 1e-12);
  EXPECT_NEAR(wrap_angle_rad(-kPi), kPi, 1e-12);
  EXPECT_NEAR(wrap_angle_rad(100.0 * kPi + 0.25), 0.25, 1e-10);
}

TEST(CameraIntrinsics, ProjectionAndBackProjectionAgree) {
  const CameraIntrinsics camera = CameraIntrinsics::from_fov(320, 240, 1.2);
  const glm::dvec3 p(0.4, -0.2, 2.5);
  expect_near(camera.back_project(camera.project(p), p.z), p, 1e-12);
  EXPECT_NEAR(camera.horizontal_fov_rad(), 1.2, 1e-12);
}

TEST(CameraIntrinsics, ResizingKeepsTheRays) {
  const CameraIntrinsics camera{640, 480, 500.0, 510.0, 319.0, 241.0};
  const CameraIntrinsics half = camera.resized(320, 240);
  const glm::dvec3 p(0.4, -0.2, 2.5);
  EXPECT_NEAR(half.project(p).x, 0.5 * camera.project(p).x, 1e-12);
  EXPECT_NEAR(half.project(p).y, 0.5 * camera.project(p).y, 1e-12);
}

}  // namespace
}  // namespace segsim::core
