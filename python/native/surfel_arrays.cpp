#include "python/native/surfel_arrays.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include <nanobind/ndarray.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/string.h>

#include "core/error.h"
#include "python/native/owned_array.h"
#include "renderer/files/ply_io.h"

namespace segsim::python {
namespace {

namespace nb = nanobind;
using namespace nb::literals;
using core::InputError;
using renderer::SurfelCloud;

template <class Scalar>
using Numbers = nb::ndarray<const Scalar, nb::c_contig, nb::device::cpu>;

/// An opacity of 1 has no logit.
constexpr float kLargestOpacity = 1.0F - std::numeric_limits<float>::epsilon() / 2.0F;

nb::dict parameters_of(const Scene& scene) {
  const SurfelCloud& surfels = *scene.content.surfels;
  const std::size_t count = surfels.size();
  std::vector<float> log_scales, rotations, logits;
  log_scales.reserve(2 * count), rotations.reserve(4 * count), logits.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const glm::quat& q = surfels.R_world_surfel[i];
    rotations.insert(rotations.end(), {q.w, q.x, q.y, q.z});
    log_scales.push_back(std::log(surfels.scale_m[i].x));
    log_scales.push_back(std::log(surfels.scale_m[i].y));
    const float opacity = std::min(surfels.opacity[i], kLargestOpacity);
    logits.push_back(std::log(opacity / (1.0F - opacity)));
  }
  nb::dict named;
  named["positions_m"] =
      owned_array<float>(std::vector<glm::vec3>(surfels.position_m), {count, 3});
  named["log_scales"] = owned_array(std::move(log_scales), {count, 2});
  named["rotations"] = owned_array(std::move(rotations), {count, 4});
  named["opacity_logits"] = owned_array(std::move(logits), {count});
  named["sh"] =
      owned_array<float>(std::vector<glm::vec3>(surfels.sh), {count, surfels.sh_count(), 3});
  return named;
}

/// @param shape  SIZE_MAX: any length.
template <class Scalar>
Numbers<Scalar> numbers_of(nb::handle values, const char* name, const char* type,
                           const std::vector<std::size_t>& shape) {
  const nb::object array =
      nb::module_::import_("numpy").attr("asarray")(values, "dtype"_a = type, "order"_a = "C");
  auto numbers = nb::cast<Numbers<Scalar>>(array);
  bool fits = numbers.ndim() == shape.size();
  std::string expected, found;
  for (std::size_t axis = 0; axis < shape.size(); ++axis) {
    const std::string any = axis > 0 ? "K" : "N";
    expected +=
        (axis > 0 ? ", " : "") + (shape[axis] == SIZE_MAX ? any : std::to_string(shape[axis]));
    fits = fits && (shape[axis] == SIZE_MAX || numbers.shape(axis) == shape[axis]);
  }
  for (std::size_t axis = 0; axis < numbers.ndim(); ++axis) {
    found += (axis > 0 ? ", " : "") + std::to_string(numbers.shape(axis));
  }
  if (!fits) throw InputError::expected(name, "shape [" + expected + "]", "[" + found + "]");
  if constexpr (std::is_floating_point_v<Scalar>) {
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      if (std::isfinite(numbers.data()[i])) continue;
      throw InputError::expected(name, "finite numbers", std::to_string(numbers.data()[i]));
    }
  }
  return numbers;
}

/// What a surfel must have to be drawn.
void check_surfel(const SurfelCloud& surfels, std::size_t i, float rotation_length) {
  const auto place = [i](const char* name) {
    return std::string(name) + "[" + std::to_string(i) + "]";
  };
  const glm::vec2& scale = surfels.scale_m[i];
  if (!(scale.x > 0.0F && scale.y > 0.0F && std::isfinite(scale.x) &&
        std::isfinite(scale.y))) {
    throw InputError::expected(
        place("log_scales"), "logarithms of lengths that floats hold",
        std::to_string(scale.x) + " m, " + std::to_string(scale.y) + " m");
  }
  if (!(surfels.opacity[i] > 0.0F)) {
    throw InputError::expected(place("opacity_logits"), "an opacity above 0", "0");
  }
  if (!(rotation_length > 0.0F && std::isfinite(rotation_length))) {
    throw InputError::expected(place("rotations"), "a quaternion that is not 0",
                               "one of length " + std::to_string(rotation_length));
  }
}

Scene scene_of(nb::handle positions_m, nb::handle log_scales, nb::handle rotations,
               nb::handle opacity_logits, nb::handle sh, nb::handle semantic,
               nb::handle instance, const std::string& name) {
  const auto position =
      numbers_of<float>(positions_m, "positions_m", "float32", {SIZE_MAX, 3});
  const std::size_t count = position.shape(0);
  const auto scale = numbers_of<float>(log_scales, "log_scales", "float32", {count, 2});
  const auto rotation = numbers_of<float>(rotations, "rotations", "float32", {count, 4});
  const auto logit = numbers_of<float>(opacity_logits, "opacity_logits", "float32", {count});
  const auto colour = numbers_of<float>(sh, "sh", "float32", {count, SIZE_MAX, 3});
  SurfelCloud surfels;
  while (surfels.sh_degree < 3 && surfels.sh_count() < colour.shape(1)) ++surfels.sh_degree;
  if (surfels.sh_count() != colour.shape(1)) {
    throw InputError::expected("sh", "1, 4, 9 or 16 coefficients of a colour",
                               std::to_string(colour.shape(1)));
  }
  for (std::size_t i = 0; i < count; ++i) {
    const float* p = position.data() + 3 * i;
    const float* q = rotation.data() + 4 * i;
    const glm::quat raw(q[0], q[1], q[2], q[3]);
    surfels.position_m.emplace_back(p[0], p[1], p[2]);
    surfels.scale_m.emplace_back(std::exp(scale.data()[2 * i]),
                                 std::exp(scale.data()[2 * i + 1]));
    surfels.opacity.push_back(1.0F / (1.0F + std::exp(-logit.data()[i])));
    check_surfel(surfels, i, glm::length(raw));
    surfels.R_world_surfel.push_back(glm::normalize(raw));
  }
  for (std::size_t k = 0; k < colour.size(); k += 3) {
    surfels.sh.emplace_back(colour.data()[k], colour.data()[k + 1], colour.data()[k + 2]);
  }
  if (semantic.is_none() != instance.is_none()) {
    throw InputError::expected("instance", "labels of both kinds, or none", "one kind");
  }
  if (!semantic.is_none()) {
    const auto classes = numbers_of<std::uint16_t>(semantic, "semantic", "uint16", {count});
    const auto objects = numbers_of<std::uint16_t>(instance, "instance", "uint16", {count});
    surfels.semantic_id.assign(classes.data(), classes.data() + count);
    surfels.instance_id.assign(objects.data(), objects.data() + count);
  }
  Scene scene;
  scene.name = name;
  scene.content.surfels = std::make_shared<const SurfelCloud>(std::move(surfels));
  return scene;
}

void save(const Scene& scene, const std::filesystem::path& file) {
  if (file.extension() != ".ply") {
    throw InputError::expected("path", "a name that ends in .ply", file.string());
  }
  renderer::write_surfels_ply(file, *scene.content.surfels);
}

}  // namespace

void bind_surfel_arrays(nb::class_<Scene>& scene) {
  scene.def("surfel_parameters", &parameters_of,
            nb::sig("def surfel_parameters(self) -> dict[str, "
                    "numpy.typing.NDArray[numpy.float32]]"),
            "The surfels as fastsegsim.differentiable.rasterize() takes them: positions_m "
            "[N, 3], log_scales [N, 2], rotations [N, 4] (w x y z), opacity_logits [N] and sh "
            "[N, K, 3], copies in single precision.");
  scene.def_static(
      "from_parameters", &scene_of, "positions_m"_a, "log_scales"_a, "rotations"_a,
      "opacity_logits"_a, "sh"_a, "semantic"_a = nb::none(), "instance"_a = nb::none(),
      "name"_a = "surfels",
      nb::sig("def from_parameters(positions_m: numpy.typing.ArrayLike, log_scales: "
              "numpy.typing.ArrayLike, rotations: numpy.typing.ArrayLike, opacity_logits: "
              "numpy.typing.ArrayLike, sh: numpy.typing.ArrayLike, semantic: "
              "numpy.typing.ArrayLike | None = None, instance: numpy.typing.ArrayLike | None "
              "= None, name: str = 'surfels') -> Scene"),
      "A scene of surfels as surfel_parameters() gives them, to be drawn or saved; path is "
      "empty.\n\n"
      "semantic, instance: SceneClass.id and SceneInstance.id of each surfel, [N], 0 to "
      "65535; "
      "both or none. Raises InputError, naming the argument and the surfel.");
  scene.def(
      "save", &save, "path"_a, nb::call_guard<nb::gil_scoped_release>(),
      nb::sig("def save(self, path: str | os.PathLike[str]) -> None"),
      "Write the surfels in the layout of the 2DGS code (.ply), with their labels and "
      "features. The names of classes and objects and the cameras of a bundle are not in "
      "it.");
}

}  // namespace segsim::python
