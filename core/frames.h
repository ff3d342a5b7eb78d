#pragma once

/// @file
/// Coordinate frames as types: a transform that is composed in the wrong order does not
/// compile. docs/conventions.md draws each frame's axes.

#include <cmath>

#include <glm/gtc/quaternion.hpp>
#include <glm/mat4x4.hpp>
#include <glm/vec3.hpp>

namespace segsim::core {

/// Frame tags.
namespace frame {
struct World;   ///< Fixed. z up; x east and y north when the scene has a geodetic origin.
struct Robot;   ///< Moves with the base, on the floor. x forward, y left, z up.
struct Camera;  ///< Optical. x right, y down, z forward.
struct Odom;    ///< World as the robot believes it. x forward at start, z up.
}  // namespace frame

/// Coordinates of a point, expressed in `Frame`.
template <class Frame>
struct Point {
  glm::dvec3 xyz_m;
};

/// Rigid transform that re-expresses `From` coordinates in `To`:
///
///     Point<World> p_world = T_world_camera * p_camera;
///     Transform<World, Camera> T_world_camera = T_world_robot * T_robot_camera;
///
/// Neighbouring frame names must match, in the variable names and in the types;
/// T_world_camera * T_world_robot does not compile.
template <class To, class From>
class Transform {
 public:
  /// Identity.
  Transform() : R_to_from_(1.0, 0.0, 0.0, 0.0), p_to_from_m_(0.0) {}

  /// @param R_to_from  Unit quaternion.
  /// @param p_to_from_m  Origin of `From`, expressed in `To` [m].
  Transform(const glm::dquat& R_to_from, const glm::dvec3& p_to_from_m)
      : R_to_from_(R_to_from), p_to_from_m_(p_to_from_m) {}

  Point<To> operator*(const Point<From>& p_from) const {
    return {R_to_from_ * p_from.xyz_m + p_to_from_m_};
  }

  template <class Inner>
  Transform<To, Inner> operator*(const Transform<From, Inner>& T_from_inner) const {
    return {R_to_from_ * T_from_inner.rotation(),
            R_to_from_ * T_from_inner.translation_m() + p_to_from_m_};
  }

  [[nodiscard]] Transform<From, To> inverse() const {
    const glm::dquat R_from_to = glm::conjugate(R_to_from_);
    return {R_from_to, -(R_from_to * p_to_from_m_)};
  }

  [[nodiscard]] const glm::dquat& rotation() const { return R_to_from_; }
  [[nodiscard]] const glm::dvec3& translation_m() const { return p_to_from_m_; }

 private:
  glm::dquat R_to_from_;
  glm::dvec3 p_to_from_m_;
};

using CameraPose = Transform<frame::World, frame::Camera>;

/// Pose of the robot base on the floor plane of `World` or `Odom`.
struct Pose2 {
  double x_m = 0.0, y_m = 0.0;
  double yaw_rad = 0.0;  ///< About +z, counter-clockwise, 0 = +x.
};

/// Angle brought to (-pi, pi].
[[nodiscard]] inline double wrap_angle_rad(double angle_rad) {
  const double wrapped = std::remainder(angle_rad, 2.0 * 3.14159265358979323846);
  return wrapped <= -3.14159265358979323846 ? 3.14159265358979323846 : wrapped;
}

/// The planar pose as a transform at height `z_m`.
template <class To, class From = frame::Robot>
[[nodiscard]] Transform<To, From> transform_from_pose2(const Pose2& pose, double z_m = 0.0) {
  const double half = 0.5 * pose.yaw_rad;
  return {glm::dquat(std::cos(half), 0.0, 0.0, std::sin(half)), {pose.x_m, pose.y_m, z_m}};
}

/// Camera on a mast: `height_m` above the floor and `forward_m` ahead of the base, looking
/// along the robot's +x, pitched down by `pitch_down_rad`.
[[nodiscard]] Transform<frame::Robot, frame::Camera> mast_camera(double height_m,
                                                                 double pitch_down_rad,
                                                                 double forward_m = 0.0);

/// A camera at `eye_m` that looks at `target_m`, image "up" towards world +z (any frame with z
/// up).
/// @throws ContractViolation if the two points coincide.
[[nodiscard]] CameraPose look_at(const glm::dvec3& eye_m, const glm::dvec3& target_m);

}  // namespace segsim::core
