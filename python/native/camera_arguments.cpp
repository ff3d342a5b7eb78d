#include "python/native/camera_arguments.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>

#include <nanobind/ndarray.h>
#include <glm/gtc/quaternion.hpp>
#include <glm/matrix.hpp>

#include "core/error.h"
#include "python/native/owned_array.h"

namespace segsim::python {
namespace {

namespace nb = nanobind;
using namespace nb::literals;
using Numbers = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;

/// Poses that were computed or stored in single precision pass; a scale or a shear does not.
constexpr double kRotationTolerance = 1e-4;
constexpr double kZeroTolerance = 1e-6;

Numbers numbers_of(nb::handle value) {
  Numbers numbers;
  if (nb::try_cast(value, numbers, false)) return numbers;
  const nb::object numpy = nb::module_::import_("numpy");
  return nb::cast<Numbers>(
      numpy.attr("asarray")(value, "dtype"_a = "float64", "order"_a = "C"));
}

std::string shape_of(const Numbers& numbers) {
  std::vector<std::size_t> shape;
  for (std::size_t axis = 0; axis < numbers.ndim(); ++axis) {
    shape.push_back(numbers.shape(axis));
  }
  return shape_text(shape);
}

/// Square matrices of that side, one or several.
struct Matrices {
  Numbers numbers;  ///< Owns the memory.
  std::size_t side, count;
  bool several;

  [[nodiscard]] const double* at(std::size_t index) const {
    return numbers.data() + index * side * side;
  }
};

Matrices matrices_of(nb::handle value, std::size_t side, const char* name) {
  Numbers numbers = numbers_of(value);
  const std::size_t axes = numbers.ndim();
  const bool several = axes == 3;
  if ((axes != 2 && !several) || numbers.shape(axes - 1) != side ||
      numbers.shape(axes - 2) != side) {
    const std::string one = std::to_string(side) + ", " + std::to_string(side) + "]";
    throw core::InputError::expected(name, "shape [" + one + " or [N, " + one,
                                     shape_of(numbers));
  }
  const std::size_t count = several ? numbers.shape(0) : 1;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (std::isfinite(numbers.data()[i])) continue;
    throw core::InputError::expected(name, "finite numbers",
                                     std::to_string(numbers.data()[i]));
  }
  return {std::move(numbers), side, count, several};
}

/// "K" or "K[3]".
std::string place_of(const char* name, const Matrices& matrices, std::size_t index) {
  return matrices.several ? name + ("[" + std::to_string(index) + "]") : name;
}

bool is_zero(double value) { return std::abs(value) <= kZeroTolerance; }

core::CameraPose pose_of(const double* m, const std::string& place) {
  if (!is_zero(m[12]) || !is_zero(m[13]) || !is_zero(m[14]) || !is_zero(m[15] - 1.0)) {
    throw core::InputError::expected(place, "(0, 0, 0, 1) in the last row",
                                     std::to_string(m[12]) + ", " + std::to_string(m[13]) +
                                         ", " + std::to_string(m[14]) + ", " +
                                         std::to_string(m[15]));
  }
  const glm::dmat3 R({m[0], m[4], m[8]}, {m[1], m[5], m[9]}, {m[2], m[6], m[10]});
  const glm::dmat3 difference = glm::transpose(R) * R - glm::dmat3(1.0);
  double largest = 0.0;
  for (int column = 0; column < 3; ++column) {
    for (int row = 0; row < 3; ++row) {
      largest = std::max(largest, std::abs(difference[column][row]));
    }
  }
  if (largest > kRotationTolerance) {
    throw core::InputError::expected(place, "a rotation in the first three rows and columns",
                                     "columns whose products differ by " +
                                         std::to_string(largest) +
                                         " from those of orthogonal unit vectors");
  }
  if (glm::determinant(R) < 0.0) {
    throw core::InputError::expected(place, "a rotation in the first three rows and columns",
                                     "a reflection");
  }
  return {glm::normalize(glm::quat_cast(R)), {m[3], m[7], m[11]}};
}

core::CameraIntrinsics intrinsics_of(const double* k, std::pair<int, int> size_px,
                                     const std::string& place) {
  if (!is_zero(k[1]) || !is_zero(k[3]) || !is_zero(k[6]) || !is_zero(k[7]) ||
      !is_zero(k[8] - 1.0)) {
    throw core::InputError::expected(place, "rows (fx, 0, cx), (0, fy, cy), (0, 0, 1)",
                                     "something else in place of a 0 or the 1");
  }
  if (k[0] <= 0.0 || k[4] <= 0.0) {
    throw core::InputError::expected(place, "focal lengths above 0",
                                     std::to_string(k[0]) + ", " + std::to_string(k[4]));
  }
  return {size_px.first, size_px.second, k[0], k[4], k[2], k[5]};
}

void check_size(std::pair<int, int> size_px) {
  for (const int side_px : {size_px.first, size_px.second}) {
    if (side_px >= 1 && side_px <= kLongestSide_px) continue;
    throw core::InputError::expected(
        "size", "width and height of 1 to " + std::to_string(kLongestSide_px) + " pixels",
        std::to_string(size_px.first) + " x " + std::to_string(size_px.second));
  }
}

/// The matrix of a pose, row by row.
void append_rows(const core::CameraPose& pose, std::vector<double>& rows) {
  const glm::dmat3 R = glm::mat3_cast(pose.rotation());
  for (int row = 0; row < 3; ++row) {
    rows.insert(rows.end(), {R[0][row], R[1][row], R[2][row], pose.translation_m()[row]});
  }
  rows.insert(rows.end(), {0.0, 0.0, 0.0, 1.0});
}

}  // namespace

std::string shape_text(const std::vector<std::size_t>& shape) {
  std::string text = "[";
  for (const std::size_t length : shape) {
    text += (text.size() > 1 ? ", " : "") + std::to_string(length);
  }
  return text + "]";
}

Views views_of(nb::handle T_world_camera, nb::handle K, std::pair<int, int> size_px) {
  check_size(size_px);
  const Matrices poses = matrices_of(T_world_camera, 4, "T_world_camera");
  const Matrices cameras = matrices_of(K, 3, "K");
  if (cameras.several && (!poses.several || cameras.count != poses.count)) {
    throw core::InputError::expected(
        "K",
        poses.several ? "one matrix, or " + std::to_string(poses.count) + " as there are poses"
                      : "one matrix, as there is one pose",
        shape_of(cameras.numbers));
  }
  Views views;
  views.batch = poses.several;
  for (std::size_t i = 0; i < poses.count; ++i) {
    views.T_world_camera.push_back(pose_of(poses.at(i), place_of("T_world_camera", poses, i)));
  }
  for (std::size_t i = 0; i < cameras.count; ++i) {
    views.intrinsics.push_back(
        intrinsics_of(cameras.at(i), size_px, place_of("K", cameras, i)));
  }
  return views;
}

nb::object pose_matrix(const core::CameraPose& T_world_camera) {
  std::vector<double> rows;
  append_rows(T_world_camera, rows);
  return owned_array(std::move(rows), {4, 4});
}

nb::object pose_matrices(std::span<const core::CameraPose> T_world_camera) {
  std::vector<double> rows;
  for (const core::CameraPose& pose : T_world_camera) append_rows(pose, rows);
  return owned_array(std::move(rows), {T_world_camera.size(), 4, 4});
}

nb::object camera_matrix(const core::CameraIntrinsics& intrinsics) {
  return owned_array(std::vector<double>{intrinsics.fx_px, 0.0, intrinsics.cx_px,  //
                                         0.0, intrinsics.fy_px, intrinsics.cy_px,  //
                                         0.0, 0.0, 1.0},
                     {3, 3});
}

}  // namespace segsim::python
