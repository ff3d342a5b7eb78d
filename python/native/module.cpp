// The extension module fastsegsim._native; the package's __init__.py shows what is in it.
#include <array>
#include <numbers>
#include <string>
#include <utility>

#include <nanobind/nanobind.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>

#include "core/camera.h"
#include "core/error.h"
#include "core/frames.h"
#include "core/version.h"
#include "python/native/camera_arguments.h"
#include "python/native/frame_file.h"
#include "python/native/scene.h"
#include "python/native/scene_renderer.h"

namespace segsim::python {
namespace {

namespace nb = nanobind;
using namespace nb::literals;

glm::dvec3 vector_of(const std::array<double, 3>& xyz) { return {xyz[0], xyz[1], xyz[2]}; }

nb::object look_at(const std::array<double, 3>& eye_m, const std::array<double, 3>& target_m) {
  const glm::dvec3 eye = vector_of(eye_m), target = vector_of(target_m);
  constexpr double kLeastDistance_m = 1e-9;
  if (!(glm::length(target - eye) > kLeastDistance_m)) {
    throw core::InputError::expected("target_m", "another point than eye_m", "the same");
  }
  return pose_matrix(core::look_at(eye, target));
}

nb::object mast_camera(const std::array<double, 3>& base, double height_m,
                       double pitch_down_rad) {
  const core::Pose2 pose{base[0], base[1], base[2]};
  return pose_matrix(core::transform_from_pose2<core::frame::World>(pose) *
                     core::mast_camera(height_m, pitch_down_rad));
}

nb::object pinhole(std::pair<int, int> size_px, double horizontal_fov_rad) {
  if (size_px.first < 1 || size_px.second < 1) {
    throw core::InputError::expected(
        "size", "width and height of at least 1 pixel",
        std::to_string(size_px.first) + " x " + std::to_string(size_px.second));
  }
  if (!(horizontal_fov_rad > 0.0 && horizontal_fov_rad < std::numbers::pi)) {
    throw core::InputError::expected("horizontal_fov_rad", "an angle between 0 and pi",
                                     std::to_string(horizontal_fov_rad));
  }
  return camera_matrix(
      core::CameraIntrinsics::from_fov(size_px.first, size_px.second, horizontal_fov_rad));
}

void bind_cameras(nb::module_& module) {
  module.def("look_at", &look_at, "eye_m"_a, "target_m"_a,
             nb::sig("def look_at(eye_m: collections.abc.Sequence[float], target_m: "
                     "collections.abc.Sequence[float]) -> "
                     "numpy.typing.NDArray[numpy.float64]"),
             "T_world_camera [4, 4] of a camera at eye_m that looks at target_m, with the "
             "world's z upwards in the image. Metres, world frame.");
  module.def("mast_camera", &mast_camera, "base"_a, "height_m"_a, "pitch_down_rad"_a = 0.0,
             nb::sig("def mast_camera(base: collections.abc.Sequence[float], height_m: float, "
                     "pitch_down_rad: float = 0.0) -> numpy.typing.NDArray[numpy.float64]"),
             "T_world_camera [4, 4] of a camera on a robot: base is (x [m], y [m], yaw [rad]) "
             "in the world frame, yaw counter-clockwise from +x; the camera is height_m above "
             "the floor and looks along the robot's +x. As `segsim render --pose`.");
  module.def("pinhole", &pinhole, "size"_a, "horizontal_fov_rad"_a,
             nb::sig("def pinhole(size: tuple[int, int], horizontal_fov_rad: float) -> "
                     "numpy.typing.NDArray[numpy.float64]"),
             "K [3, 3] of a camera with square pixels and the principal point in the middle "
             "of an image of (width, height) pixels.");
}

}  // namespace
}  // namespace segsim::python

NB_MODULE(_native, module) {
  using namespace segsim;
  module.doc() = "What of Fast-SegSim is C++: scenes and their renderer.";
  module.attr("build") = core::version();
  const nanobind::exception<core::InputError> input_error(module, "InputError",
                                                          PyExc_ValueError);
  input_error.attr("__doc__") =
      "A file or an argument is at fault. The message names it, what was expected and what "
      "was found.";
  python::bind_cameras(module);
  python::bind_scene(module);
  python::bind_renderer(module);
  python::bind_frame_files(module);
}
