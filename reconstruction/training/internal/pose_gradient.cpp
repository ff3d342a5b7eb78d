#include "reconstruction/training/internal/pose_gradient.h"

#include <cmath>
#include <vector>

#include "reconstruction/rasterizer/sh_adjoint.h"
#include "renderer/scene/sphere_quadrature.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr int kCoefficients = 16;

/// d B_row(R d) / d angle of R about one axis = sum over columns of value * B_column(d).
struct Mixing {
  int row, column, axis;
  double value;
};

/// Integrals of (axis x d) . grad B_row times B_column over the sphere: polynomials of
/// degree 6.
std::vector<Mixing> make_mixings() {
  double sums[3][kCoefficients][kCoefficients] = {};
  for (const renderer::internal::SphereNode& node : renderer::internal::sphere_quadrature()) {
    const renderer::Vec3<double> d{node.x, node.y, node.z};
    const renderer::Vec3<double> turned[3] = {
        {0.0, -d.z, d.y}, {d.z, 0.0, -d.x}, {-d.y, d.x, 0.0}};
    double basis[kCoefficients];
    renderer::sh_basis(3, d, basis);
    for (int row = 1; row < kCoefficients; ++row) {
      double one[kCoefficients] = {};
      one[row] = 1.0;
      const renderer::Vec3<double> slope = sh_basis_adjoint(3, d, one);
      for (int axis = 0; axis < 3; ++axis) {
        const double change = renderer::dot(slope, turned[axis]) * node.weight;
        for (int column = 1; column < kCoefficients; ++column) {
          sums[axis][row][column] += change * basis[column];
        }
      }
    }
  }
  std::vector<Mixing> mixings;
  for (int axis = 0; axis < 3; ++axis) {
    for (int row = 1; row < kCoefficients; ++row) {
      for (int column = 1; column < kCoefficients; ++column) {
        const double value = sums[axis][row][column];
        if (std::abs(value) > 1e-9) mixings.push_back({row, column, axis, value});
      }
    }
  }
  return mixings;
}

/// Sum over the first dimension in its order, whatever the number of threads.
std::vector<double> ordered_sum(const Tensor& terms) {
  const Tensor host = terms.is_cpu() ? terms.contiguous() : terms.sum(0, true).cpu();
  const auto* value = host.data_ptr<double>();
  std::vector<double> sums(static_cast<std::size_t>(host.size(1)), 0.0);
  for (std::int64_t i = 0; i < host.size(0); ++i) {
    for (double& sum : sums) sum += *value++;
  }
  return sums;
}

/// Torque of the turning colours, [n, 3].
Tensor color_torque(const Tensor& sh, const Tensor& by_sh) {
  static const std::vector<Mixing> mixings = make_mixings();
  Tensor torque = torch::zeros({sh.size(0), 3}, sh.options().dtype(torch::kFloat64));
  for (const Mixing& m : mixings) {
    if (m.row >= sh.size(1) || m.column >= sh.size(1)) continue;
    const Tensor product = sh.select(1, m.row).to(torch::kFloat64) *
                           by_sh.select(1, m.column).to(torch::kFloat64);
    const Tensor sum = (product.select(1, 0) + product.select(1, 1)) + product.select(1, 2);
    torque.select(1, m.axis).sub_(sum, m.value);
  }
  return torque;
}

}  // namespace

CameraGradient camera_gradient(const SurfelTensors& surfels, const SurfelTensors& gradients,
                               const core::CameraPose& T_world_camera) {
  const at::NoGradGuard no_grad;
  const auto real = [](const Tensor& t) { return t.detach().to(torch::kFloat64); };
  const glm::dvec3 eye_m = T_world_camera.translation_m();
  Tensor offset_m = real(surfels.position_m).clone();
  for (int axis = 0; axis < 3; ++axis) offset_m.select(1, axis).sub_(eye_m[axis]);
  const Tensor force = real(gradients.position_m);
  const Tensor q = real(surfels.rotation), by_q = real(gradients.rotation);
  const Tensor v = q.narrow(1, 1, 3), by_v = by_q.narrow(1, 1, 3);
  Tensor torque = at::cross(offset_m, force, 1);
  torque.add_(q.narrow(1, 0, 1) * by_v - by_q.narrow(1, 0, 1) * v + at::cross(v, by_v, 1),
              0.5);
  torque.add_(color_torque(surfels.sh.detach(), gradients.sh.detach()));
  const std::vector<double> sums = ordered_sum(at::cat({force, torque}, 1));

  const glm::dquat R_camera_world = glm::inverse(T_world_camera.rotation());
  const glm::dvec3 t = R_camera_world * glm::dvec3(sums[0], sums[1], sums[2]);
  const glm::dvec3 w = R_camera_world * glm::dvec3(sums[3], sums[4], sums[5]);
  return {{-t.x, -t.y, -t.z}, {-w.x, -w.y, -w.z}};
}

}  // namespace segsim::reconstruction::internal
