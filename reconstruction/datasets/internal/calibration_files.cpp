#include "reconstruction/datasets/internal/calibration_files.h"

#include <cmath>
#include <cstdlib>
#include <sstream>

#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/formatted.h"
#include "core/input/bounds.h"

namespace segsim::reconstruction::internal {
namespace {

using core::InputError;

constexpr double kRotationTolerance = 1e-2;

std::string text_of(double value) {
  std::ostringstream out;
  out.precision(6);
  out << value;
  return out.str();
}

double largest_entry(const glm::dmat3& m) {
  double largest = 0.0;
  for (int column = 0; column < 3; ++column) {
    for (int row = 0; row < 3; ++row) largest = std::max(largest, std::abs(m[column][row]));
  }
  return largest;
}

/// Nearest orthonormal matrix (polar factor) by Newton's iteration R <- (R + R^-T) / 2, which
/// converges quadratically for a matrix this close to a rotation.
glm::dmat3 nearest_rotation(glm::dmat3 R) {
  for (int i = 0; i < 6; ++i) R = 0.5 * (R + glm::transpose(glm::inverse(R)));
  return R;
}

}  // namespace

std::vector<NumberLine> read_number_lines(const std::filesystem::path& file) {
  std::istringstream text(core::read_file(file));
  std::vector<NumberLine> lines;
  std::string line;
  for (int number = 1; std::getline(text, line); ++number) {
    for (char& c : line) {
      if (c == ',' || c == '\r') c = ' ';
    }
    std::istringstream words(line);
    std::string word;
    NumberLine entry{number, {}};
    while (words >> word) {
      char* end = nullptr;
      const double value = std::strtod(word.c_str(), &end);
      if (end == word.c_str() || *end != '\0') {
        throw InputError::expected(file.string() + ":" + std::to_string(number), "a number",
                                   "'" + word + "'");
      }
      entry.numbers.push_back(value);
    }
    if (!entry.numbers.empty()) lines.push_back(std::move(entry));
  }
  return lines;
}

core::CameraIntrinsics read_intrinsics(const std::filesystem::path& file,
                                       const ImageSize& size, double center_offset_px) {
  std::vector<double> n;
  for (const NumberLine& line : read_number_lines(file)) {
    n.insert(n.end(), line.numbers.begin(), line.numbers.end());
  }
  if (n.size() != 4 && n.size() != 9 && n.size() != 16) {
    throw InputError::expected(file.string(), "9 numbers (3x3), 16 (4x4) or 4 (fx fy cx cy)",
                               std::to_string(n.size()) + " numbers");
  }
  for (const double value : n) {
    if (!std::isfinite(value)) {
      throw InputError::expected(file.string(), "finite numbers", text_of(value));
    }
  }
  const std::size_t columns = n.size() == 9 ? 3 : 4;  // Of the matrix forms.
  const bool matrix = n.size() != 4;
  const double skew = matrix ? n[1] : 0.0;
  core::CameraIntrinsics camera;
  camera.width_px = size.width_px;
  camera.height_px = size.height_px;
  camera.fx_px = n[0];
  camera.fy_px = matrix ? n[columns + 1] : n[1];
  camera.cx_px = n[2] + center_offset_px;
  camera.cy_px = (matrix ? n[columns + 2] : n[3]) + center_offset_px;

  if (camera.fx_px <= 0.0 || camera.fy_px <= 0.0) {
    throw InputError::expected(file.string(), "focal lengths > 0",
                               text_of(camera.fx_px) + " and " + text_of(camera.fy_px));
  }
  if (std::abs(skew) > 1e-6 * camera.fx_px) {
    throw InputError::expected(file.string(), "a camera matrix without skew", text_of(skew));
  }
  if (matrix &&
      (n[2 * columns] != 0.0 || n[2 * columns + 1] != 0.0 || n[2 * columns + 2] != 1.0)) {
    throw InputError::expected(file.string(), "a camera matrix with third row 0 0 1",
                               text_of(n[2 * columns]) + " " + text_of(n[2 * columns + 1]) +
                                   " " + text_of(n[2 * columns + 2]));
  }
  if (camera.cx_px <= 0.0 || camera.cx_px >= size.width_px || camera.cy_px <= 0.0 ||
      camera.cy_px >= size.height_px) {
    throw InputError::expected(file.string(),
                               "a principal point inside the " +
                                   std::to_string(size.width_px) + "x" +
                                   std::to_string(size.height_px) + " image",
                               text_of(camera.cx_px) + ", " + text_of(camera.cy_px));
  }
  return camera;
}

core::CameraPose pose_from_matrix(std::span<const double> numbers, const std::string& place) {
  if (numbers.size() != 16) {
    throw InputError::expected(place, "16 numbers (4x4 camera-to-world)",
                               std::to_string(numbers.size()) + " numbers");
  }
  for (const double value : numbers) {
    if (!core::within_world(value)) {
      throw InputError::expected(
          place, core::print("finite numbers within %g", core::kFarthest_m), text_of(value));
    }
  }
  if (std::abs(numbers[12]) > 1e-6 || std::abs(numbers[13]) > 1e-6 ||
      std::abs(numbers[14]) > 1e-6 || std::abs(numbers[15] - 1.0) > 1e-6) {
    throw InputError::expected(place, "a last row 0 0 0 1",
                               text_of(numbers[12]) + " " + text_of(numbers[13]) + " " +
                                   text_of(numbers[14]) + " " + text_of(numbers[15]));
  }
  glm::dmat3 R;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) R[column][row] = numbers[4 * row + column];
  }
  const double error = largest_entry(glm::transpose(R) * R - glm::dmat3(1.0));
  if (error > kRotationTolerance) {
    throw InputError::expected(place, "an orthonormal rotation (tolerance 0.01)",
                               "one that is off by " + text_of(error));
  }
  if (glm::determinant(R) < 0.0) {
    throw InputError::expected(place, "a rotation with determinant +1",
                               text_of(glm::determinant(R)) + " (mirrored axes)");
  }
  return {glm::normalize(glm::quat_cast(nearest_rotation(R))),
          {numbers[3], numbers[7], numbers[11]}};
}

core::CameraPose pose_from_quaternion(const glm::dquat& R_world_camera,
                                      const glm::dvec3& p_world_camera_m,
                                      const std::string& place) {
  const double length = glm::length(R_world_camera);
  if (!(std::abs(length - 1.0) <= kRotationTolerance)) {
    throw InputError::expected(place, "a unit quaternion (tolerance 0.01)",
                               "one of length " + text_of(length));
  }
  for (int i = 0; i < 3; ++i) {
    if (!std::isfinite(p_world_camera_m[i])) {
      throw InputError::expected(place, "a finite position", text_of(p_world_camera_m[i]));
    }
  }
  return {glm::normalize(R_world_camera), p_world_camera_m};
}

}  // namespace segsim::reconstruction::internal
