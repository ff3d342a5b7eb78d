#include "renderer/files/internal/exr_camera.h"

#include <cmath>

#include <ImathMatrix.h>
#include <OpenEXR/ImfDoubleAttribute.h>
#include <OpenEXR/ImfMatrixAttribute.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <glm/gtc/quaternion.hpp>

namespace segsim::renderer::internal {
namespace {

constexpr const char* kFrames =
    "camera: x right, y down, z forward; world: x east, y north, z up; metres";

/// For column vectors, element [row][column].
Imath::M44d matrix_of(const core::CameraPose& T_world_camera) {
  const glm::dmat3 R = glm::mat3_cast(T_world_camera.rotation());
  const glm::dvec3& p = T_world_camera.translation_m();
  Imath::M44d matrix;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) matrix[row][column] = R[column][row];
    matrix[row][3] = p[row];
  }
  return matrix;
}

/// As the library's row vectors want it.
Imath::M44f row_vector_form(const Imath::M44d& matrix) {
  return Imath::M44f(matrix.transposed());
}

}  // namespace

float exr_pixel_aspect_ratio(const core::CameraIntrinsics& intrinsics) {
  return static_cast<float>(intrinsics.fy_px / intrinsics.fx_px);
}

void set_exr_camera(const core::CameraIntrinsics& c, const core::CameraPose& T_world_camera,
                    Imf::Header& header) {
  header.insert("fx_px", Imf::DoubleAttribute(c.fx_px));
  header.insert("fy_px", Imf::DoubleAttribute(c.fy_px));
  header.insert("cx_px", Imf::DoubleAttribute(c.cx_px));
  header.insert("cy_px", Imf::DoubleAttribute(c.cy_px));
  header.insert("T_world_camera", Imf::M44fAttribute(Imath::M44f(matrix_of(T_world_camera))));
  header.insert("frames", Imf::StringAttribute(kFrames));

  const Imath::M44d T_camera_world = matrix_of(core::CameraPose(
      T_world_camera.inverse().rotation(), T_world_camera.inverse().translation_m()));
  const Imath::M44d y_up(1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1);
  const Imath::M44d ndc(c.fx_px / c.width_px, 0, c.cx_px / c.width_px, 0,    //
                        0, c.fy_px / c.height_px, c.cy_px / c.height_px, 0,  //
                        0, 0, 1, 0,                                          //
                        0, 0, 1, 0);
  Imf::addWorldToCamera(header, row_vector_form(y_up * T_camera_world));
  Imf::addWorldToNDC(header, row_vector_form(ndc * T_camera_world));
  header.screenWindowWidth() = static_cast<float>(c.width_px / c.fx_px);
  header.screenWindowCenter() = {static_cast<float>((0.5 * c.width_px - c.cx_px) / c.fx_px),
                                 static_cast<float>((c.cy_px - 0.5 * c.height_px) / c.fy_px)};
}

core::CameraIntrinsics exr_intrinsics(const ExrInput& input) {
  const core::CameraIntrinsics c{input.width_px(),
                                 input.height_px(),
                                 input.attribute<Imf::DoubleAttribute>("fx_px"),
                                 input.attribute<Imf::DoubleAttribute>("fy_px"),
                                 input.attribute<Imf::DoubleAttribute>("cx_px"),
                                 input.attribute<Imf::DoubleAttribute>("cy_px")};
  if (!(c.fx_px > 0.0 && c.fy_px > 0.0) || !std::isfinite(c.fx_px + c.fy_px) ||
      !std::isfinite(c.cx_px + c.cy_px)) {
    input.fail("fx_px, fy_px > 0 and finite cx_px, cy_px", "others");
  }
  return c;
}

core::CameraPose exr_pose(const ExrInput& input) {
  // Not double: exrheader 3.1 does not print such a matrix, and floats keep a pose
  // in a building within a micrometre.
  const Imath::M44f matrix = input.attribute<Imf::M44fAttribute>("T_world_camera");
  glm::dmat3 R(1.0);
  glm::dvec3 p(0.0);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      R[column][row] = static_cast<double>(matrix[row][column]);
    }
    p[row] = static_cast<double>(matrix[row][3]);
  }
  const glm::dmat3 product = glm::transpose(R) * R;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      // Written so that NaN fails.
      if (!(std::abs(product[i][j] - (i == j ? 1.0 : 0.0)) < 1e-3) || !std::isfinite(p[i])) {
        input.fail("a rigid T_world_camera", "another matrix");
      }
    }
  }
  return {glm::normalize(glm::quat_cast(R)), p};
}

}  // namespace segsim::renderer::internal
