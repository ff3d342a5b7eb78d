#include "reconstruction/datasets/color_depth.h"

#include <sstream>
#include <string>

#include <glm/mat3x3.hpp>

#include "core/config.h"
#include "core/file_io.h"
#include "reconstruction/datasets/internal/calibration_files.h"

namespace segsim::reconstruction {
namespace {

constexpr const char* kSchema = "segsim.color_depth";
constexpr double kFarthest_m = 1.0;  ///< Two cameras of one device.

core::CameraIntrinsics read_camera(const core::ConfigNode& node) {
  const double center = node.number_or("pixel_center", 0.5);
  if (center != 0.0 && center != 0.5) {
    node.child("pixel_center").fail("0 or 0.5", node.text("pixel_center"));
  }
  core::CameraIntrinsics camera;
  camera.width_px = static_cast<int>(node.integer("width"));
  camera.height_px = static_cast<int>(node.integer("height"));
  camera.fx_px = node.number("fx"), camera.fy_px = node.number("fy");
  camera.cx_px = node.number("cx") + 0.5 - center;
  camera.cy_px = node.number("cy") + 0.5 - center;
  if (camera.width_px < 2 || camera.height_px < 2 || camera.width_px > 32768 ||
      camera.height_px > 32768) {
    node.fail("width and height of a picture",
              std::to_string(camera.width_px) + "x" + std::to_string(camera.height_px));
  }
  if (!(camera.fx_px > 0.0 && camera.fy_px > 0.0)) {
    node.fail("focal lengths > 0", node.text("fx") + " and " + node.text("fy"));
  }
  if (!(camera.cx_px > 0.0 && camera.cx_px < camera.width_px && camera.cy_px > 0.0 &&
        camera.cy_px < camera.height_px)) {
    node.fail("a principal point inside the picture",
              node.text("cx") + ", " + node.text("cy"));
  }
  node.finish();
  return camera;
}

}  // namespace

ColorDepth read_color_depth(const std::filesystem::path& file) {
  const core::ConfigNode root = core::ConfigNode::load(file);
  if (root.text("schema") != kSchema) {
    root.child("schema").fail(kSchema, root.text("schema"));
  }
  if (root.integer("version") != 1) root.child("version").fail("1", root.text("version"));
  const core::ConfigNode matrix = root.child("T_color_depth");
  const core::CameraPose T =
      internal::pose_from_matrix(root.numbers("T_color_depth"), matrix.where());
  ColorDepth result{{T.rotation(), T.translation_m()}, {}};
  if (glm::length(T.translation_m()) > kFarthest_m) {
    std::ostringstream found;
    found << glm::length(T.translation_m()) << " m; millimetres?";
    matrix.fail("two cameras of one device, at most 1 m apart", found.str());
  }
  if (const auto camera = root.optional_child("depth_camera")) {
    result.depth_camera = read_camera(*camera);
  }
  root.finish();
  return result;
}

void write_color_depth(const std::filesystem::path& file, const ColorDepth& color_depth) {
  const glm::dmat3 R = glm::mat3_cast(color_depth.T_color_depth.rotation());
  const glm::dvec3& t_m = color_depth.T_color_depth.translation_m();
  core::write_file_atomically(file, [&](std::ostream& out) {
    out.precision(12);
    out << "schema: " << kSchema << "\nversion: 1\nT_color_depth: [\n";
    for (int row = 0; row < 3; ++row) {
      out << "  " << R[0][row] << ", " << R[1][row] << ", " << R[2][row] << ", " << t_m[row]
          << ",\n";
    }
    out << "  0, 0, 0, 1]\n";
    if (!color_depth.depth_camera) return;
    const core::CameraIntrinsics& c = *color_depth.depth_camera;
    out << "depth_camera: {width: " << c.width_px << ", height: " << c.height_px
        << ", fx: " << c.fx_px << ", fy: " << c.fy_px << ", cx: " << c.cx_px
        << ", cy: " << c.cy_px << "}\n";
  });
}

}  // namespace segsim::reconstruction
