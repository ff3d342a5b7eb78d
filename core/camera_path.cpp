#include "core/camera_path.h"

#include <cmath>
#include <limits>
#include <ostream>
#include <sstream>

#include "core/error.h"
#include "core/file_io.h"
#include "core/input/bounds.h"

namespace segsim::core {
namespace {

constexpr const char* kHeader = "segsim cameras 1";

/// One line, of which numbers are taken from the left.
class Line {
 public:
  Line(const std::filesystem::path& file, int number, const std::string& text)
      : place_(file.string() + ":" + std::to_string(number)), text_(text), in_(text) {}

  [[nodiscard]] double number() {
    double value = 0.0;
    if (!(in_ >> value) || !within_world(value)) fail("a finite number within 1e7");
    return value;
  }
  [[nodiscard]] std::string word() {
    std::string word;
    in_ >> word;
    return word;
  }
  [[nodiscard]] std::string rest() {
    std::string rest;
    std::getline(in_ >> std::ws, rest);
    return rest;
  }
  [[noreturn]] void fail(const std::string& expected) const {
    throw InputError::expected(place_, expected, "\"" + text_ + "\"");
  }

 private:
  std::string place_, text_;
  std::istringstream in_;
};

CameraIntrinsics read_intrinsics(Line line) {
  if (line.word() != "intrinsics") line.fail("intrinsics");
  CameraIntrinsics camera;
  const double width = line.number(), height = line.number();
  camera.fx_px = line.number();
  camera.fy_px = line.number();
  camera.cx_px = line.number();
  camera.cy_px = line.number();
  const auto side = [](double px) { return px >= 1.0 && px <= 65535.0; };
  const double pixels = width * height;
  if (!side(width) || !side(height) || !(pixels <= static_cast<double>(kMostPixels)) ||
      !(camera.fx_px > 0.0) || !(camera.fy_px > 0.0)) {
    line.fail("sides of 1 ... 65535 px and focal lengths above 0");
  }
  camera.width_px = static_cast<int>(width);
  camera.height_px = static_cast<int>(height);
  return camera;
}

CameraPath::View read_view(Line line) {
  glm::dvec3 p_m;
  for (int axis = 0; axis < 3; ++axis) p_m[axis] = line.number();
  glm::dquat q;
  q.x = line.number();
  q.y = line.number();
  q.z = line.number();
  q.w = line.number();
  if (!(std::abs(glm::length(q) - 1.0) < 1e-6)) line.fail("a unit quaternion");
  return {CameraPose(q, p_m), line.rest()};
}

}  // namespace

std::vector<CameraPose> CameraPath::poses() const {
  std::vector<CameraPose> poses;
  poses.reserve(views.size());
  for (const View& view : views) poses.push_back(view.T_world_camera);
  return poses;
}

void write_camera_path(const std::filesystem::path& file, const CameraPath& path) {
  write_file_atomically(file, [&](std::ostream& out) {
    out.precision(std::numeric_limits<double>::max_digits10);
    const CameraIntrinsics& camera = path.intrinsics;
    out << kHeader << "\nintrinsics " << camera.width_px << ' ' << camera.height_px << ' '
        << camera.fx_px << ' ' << camera.fy_px << ' ' << camera.cx_px << ' ' << camera.cy_px
        << '\n';
    for (const CameraPath::View& view : path.views) {
      const glm::dvec3& p_m = view.T_world_camera.translation_m();
      const glm::dquat& q = view.T_world_camera.rotation();
      for (const double value : {p_m.x, p_m.y, p_m.z, q.x, q.y, q.z, q.w}) out << value << ' ';
      out << view.frame << '\n';
    }
  });
}

CameraPath read_camera_path(const std::filesystem::path& file) {
  std::istringstream in(read_file(file));
  std::string text;
  int number = 0;
  const auto next = [&] {
    ++number;
    return static_cast<bool>(std::getline(in, text));
  };
  if (!next() || text != kHeader) Line(file, 1, text).fail(kHeader);
  if (!next()) text.clear();
  CameraPath path;
  path.intrinsics = read_intrinsics(Line(file, number, text));
  while (next()) path.views.push_back(read_view(Line(file, number, text)));
  return path;
}

}  // namespace segsim::core
