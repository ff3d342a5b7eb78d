#include "reconstruction/training/internal/training_poses.h"

#include <cmath>
#include <utility>

#include <glm/geometric.hpp>

#include "core/check.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr const char* kPoses = "poses";

glm::dquat rotation_by(const glm::dvec3& vector_rad) {
  const double angle = glm::length(vector_rad);
  const double half_sinc = angle < 1e-8 ? 0.5 : std::sin(0.5 * angle) / angle;
  return {std::cos(0.5 * angle), half_sinc * vector_rad.x, half_sinc * vector_rad.y,
          half_sinc * vector_rad.z};
}

/// Rotation vector of a unit quaternion, shorter than pi.
glm::dvec3 vector_of(glm::dquat q) {
  if (q.w < 0.0) q = -q;
  const glm::dvec3 v(q.x, q.y, q.z);
  const double sine = glm::length(v);
  return sine < 1e-12 ? 2.0 * v : v * (2.0 * std::atan2(sine, q.w) / sine);
}

Tensor zeros(std::size_t views) {
  return torch::zeros({static_cast<std::int64_t>(views), 3},
                      torch::TensorOptions().dtype(torch::kFloat64));
}

/// Takes a step and returns how far it went.
glm::dvec3 step_of(AdamTensor& adam, std::size_t view, const std::array<double, 3>& gradient,
                   double rate) {
  const auto row = static_cast<std::int64_t>(view);
  const auto at_row = [&] {
    const double* value = adam.value().data_ptr<double>() + 3 * row;
    return glm::dvec3(value[0], value[1], value[2]);
  };
  const glm::dvec3 before = at_row();
  const std::vector<double> values(gradient.begin(), gradient.end());
  adam.step_rows(torch::full({1}, row, torch::TensorOptions().dtype(torch::kInt64)),
                 device_tensor(values, torch::kFloat64, torch::kCPU).view({1, 3}), rate);
  return at_row() - before;
}

}  // namespace

core::CameraPose moved(const core::CameraPose& T_world_camera, const glm::dvec3& translation_m,
                       const glm::dvec3& rotation_rad) {
  const glm::dquat& R = T_world_camera.rotation();
  return {glm::normalize(R * rotation_by(rotation_rad)),
          T_world_camera.translation_m() + R * translation_m};
}

TrainingPoses::TrainingPoses(std::vector<core::CameraPose> recorded)
    : recorded_(std::move(recorded)),
      now_(recorded_),
      translation_(zeros(recorded_.size())),
      rotation_(zeros(recorded_.size())) {}

void TrainingPoses::step(std::size_t view, const CameraGradient& gradient, double rate_m,
                         double rate_rad) {
  SEGSIM_CHECK(view < now_.size(), std::to_string(view));
  const glm::dvec3 by_m = step_of(translation_, view, gradient.translation, rate_m);
  const glm::dvec3 by_rad = step_of(rotation_, view, gradient.rotation, rate_rad);
  now_[view] = moved(now_[view], by_m, by_rad);
}

void TrainingPoses::keep_mean() {
  const double share = 1.0 / static_cast<double>(now_.size());
  glm::dvec3 mean_m(0.0), recorded_mean_m(0.0), turn_rad(0.0);
  for (std::size_t i = 0; i < now_.size(); ++i) {
    mean_m += share * now_[i].translation_m();
    recorded_mean_m += share * recorded_[i].translation_m();
    turn_rad +=
        share * vector_of(now_[i].rotation() * glm::conjugate(recorded_[i].rotation()));
  }
  const glm::dquat back = rotation_by(-turn_rad);
  for (core::CameraPose& pose : now_) {
    pose = {glm::normalize(back * pose.rotation()),
            recorded_mean_m + back * (pose.translation_m() - mean_m)};
  }
}

void TrainingPoses::save(StateWriter& out) const {
  translation_.save(out, "pose_translation");
  rotation_.save(out, "pose_rotation");
  std::vector<double> values;
  for (const core::CameraPose& pose : now_) {
    const glm::dquat& q = pose.rotation();
    const glm::dvec3& p_m = pose.translation_m();
    values.insert(values.end(), {p_m.x, p_m.y, p_m.z, q.w, q.x, q.y, q.z});
  }
  out.put(kPoses, device_tensor(values, torch::kFloat64, torch::kCPU).view({-1, 7}));
}

void TrainingPoses::load(const StateReader& in) {
  translation_.load(in, "pose_translation");
  rotation_.load(in, "pose_rotation");
  const auto views = static_cast<std::int64_t>(now_.size());
  for (const char* name : {"pose_translation", "pose_rotation", kPoses}) {
    in.expect_rows(name, views);
  }
  const Tensor values =
      in.take(kPoses, torch::zeros({views, 7}, torch::TensorOptions().dtype(torch::kFloat64)));
  const auto* value = values.data_ptr<double>();
  for (core::CameraPose& pose : now_) {
    pose = {glm::dquat(value[3], value[4], value[5], value[6]),
            glm::dvec3(value[0], value[1], value[2])};
    value += 7;
  }
}

}  // namespace segsim::reconstruction::internal
