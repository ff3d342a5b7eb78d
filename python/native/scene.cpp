#include "python/native/scene.h"

#include <cstddef>
#include <memory>
#include <span>
#include <utility>

#include <nanobind/ndarray.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "core/bundle_parts.h"
#include "python/native/camera_arguments.h"
#include "python/native/surfel_arrays.h"
#include "renderer/files/ply_io.h"

namespace segsim::python {
namespace {

namespace nb = nanobind;
using namespace nb::literals;

/// How often each id occurs.
std::vector<std::uint64_t> count_ids(std::span<const std::uint16_t> ids) {
  std::vector<std::uint64_t> counts(std::size_t{UINT16_MAX} + 1, 0);
  for (const std::uint16_t id : ids) ++counts[id];
  return counts;
}

nb::tuple tuple_of(const glm::dvec3& v) { return nb::make_tuple(v.x, v.y, v.z); }

using PositionArray = nb::ndarray<nb::numpy, const float, nb::shape<-1, 3>, nb::c_contig>;

PositionArray positions_of(const Scene& scene) {
  const std::vector<glm::vec3>& positions = scene.content.surfels->position_m;
  static_assert(sizeof(glm::vec3) == 3 * sizeof(float));
  return PositionArray(positions.empty() ? nullptr : &positions.front().x,
                       {positions.size(), 3});
}

}  // namespace

Scene load_scene(const std::filesystem::path& path) {
  Scene scene;
  scene.path = path;
  if (path.extension() == ".ply") {
    scene.name = path.stem().string();
    scene.content.surfels =
        std::make_shared<const renderer::SurfelCloud>(renderer::read_surfels_ply(path));
    return scene;
  }
  const core::SceneBundle bundle = core::load_bundle(path);
  scene.name = bundle.manifest.name;
  scene.content = renderer::load_scene_surfels(bundle);
  const auto of_class = count_ids(scene.content.surfels->semantic_id);
  const auto of_instance = count_ids(scene.content.surfels->instance_id);
  for (const core::SceneClass& c : bundle.manifest.classes) {
    scene.classes.push_back({c, of_class[c.id]});
  }
  for (const core::SceneInstance& instance : bundle.manifest.instances) {
    scene.instances.push_back({instance, of_instance[instance.id]});
  }
  const core::BundleFile cameras = core::load_bundle_parts(path).cameras;
  if (!cameras.name.empty()) scene.recording = core::read_camera_path(path / cameras.name);
  return scene;
}

void bind_scene(nb::module_& module) {
  nb::class_<CountedClass>(module, "SceneClass", "A class that pixels of a scene can have.")
      .def_prop_ro(
          "id", [](const CountedClass& c) { return c.scene_class.id; },
          "Number in semantic images; 0 is void and not listed.")
      .def_prop_ro(
          "name", [](const CountedClass& c) { return c.scene_class.name; },
          "Lower case, COCO's word where COCO has one.")
      .def_prop_ro(
          "thing", [](const CountedClass& c) { return c.scene_class.thing; },
          "Whether its objects can be counted; walls and floors cannot.")
      .def_ro("surfels", &CountedClass::surfels, "How many surfels have this class.")
      .def("__repr__", [](const CountedClass& c) {
        return "SceneClass(id=" + std::to_string(c.scene_class.id) + ", name='" +
               c.scene_class.name + "', surfels=" + std::to_string(c.surfels) + ")";
      });

  nb::class_<CountedInstance>(module, "SceneInstance", "An object of a scene.")
      .def_prop_ro(
          "id", [](const CountedInstance& i) { return i.instance.id; },
          "Number in instance images; 0 is none and not listed.")
      .def_prop_ro(
          "class_id", [](const CountedInstance& i) { return i.instance.class_id; },
          "SceneClass.id of its class.")
      .def_prop_ro(
          "name", [](const CountedInstance& i) { return i.instance.name; },
          "As in the source of the scene.")
      .def_prop_ro(
          "box_min_m", [](const CountedInstance& i) { return tuple_of(i.instance.box_min_m); },
          nb::sig("def box_min_m(self) -> tuple[float, float, float]"),
          "Least x, y, z of its surfels in the world frame, metres.")
      .def_prop_ro(
          "box_max_m", [](const CountedInstance& i) { return tuple_of(i.instance.box_max_m); },
          nb::sig("def box_max_m(self) -> tuple[float, float, float]"),
          "Greatest x, y, z of its surfels in the world frame, metres.")
      .def_ro("surfels", &CountedInstance::surfels, "How many surfels it has.")
      .def("__repr__", [](const CountedInstance& i) {
        return "SceneInstance(id=" + std::to_string(i.instance.id) + ", name='" +
               i.instance.name + "', surfels=" + std::to_string(i.surfels) + ")";
      });

  nb::class_<core::CameraPath>(module, "Recording",
                               "The cameras that a scene was made from, for render().")
      .def_prop_ro(
          "T_world_camera",
          [](const core::CameraPath& path) { return pose_matrices(path.poses()); },
          nb::sig("def T_world_camera(self) -> numpy.typing.NDArray[numpy.float64]"),
          "Poses [N, 4, 4] in the scene's world frame, metres.")
      .def_prop_ro(
          "K", [](const core::CameraPath& path) { return camera_matrix(path.intrinsics); },
          nb::sig("def K(self) -> numpy.typing.NDArray[numpy.float64]"),
          "Camera matrix [3, 3] of all views, in pixels.")
      .def_prop_ro(
          "size",
          [](const core::CameraPath& path) {
            return nb::make_tuple(path.intrinsics.width_px, path.intrinsics.height_px);
          },
          nb::sig("def size(self) -> tuple[int, int]"), "(width, height) in pixels.")
      .def_prop_ro(
          "frames",
          [](const core::CameraPath& path) {
            nb::list names;
            for (const core::CameraPath::View& view : path.views) names.append(view.frame);
            return names;
          },
          nb::sig("def frames(self) -> list[str]"), "Names of the views in the recording.");

  nb::class_<Scene> bound(module, "Scene",
                          "Surfels with labels. World frame: metres, z up, floor at z = 0.");
  bind_surfel_arrays(bound);
  bound
      .def_static("load", &load_scene, "path"_a, nb::call_guard<nb::gil_scoped_release>(),
                  nb::sig("def load(path: str | os.PathLike[str]) -> Scene"),
                  "Read the folder of a scene bundle, or a file of surfels in the layout of "
                  "the 2DGS code (.ply).\n\n"
                  "A bundle is checked against the hashes in its manifest, and has the labels "
                  "that were corrected by hand. Raises InputError, naming the file and what "
                  "is wrong with it.")
      .def_ro("name", &Scene::name, "Name of the bundle, or of the file without its ending.")
      .def_ro("path", &Scene::path, nb::sig("def path(self) -> pathlib.Path"),
              "What was read.")
      .def_prop_ro(
          "surfels", [](const Scene& scene) { return scene.content.surfels->size(); },
          "Number of surfels.")
      .def_prop_ro(
          "has_labels",
          [](const Scene& scene) {
            return scene.content.surfels->has_labels() || scene.content.labels != nullptr;
          },
          "Whether semantic and instance images show anything.")
      .def_prop_ro(
          "has_features",
          [](const Scene& scene) { return scene.content.surfels->has_features(); },
          "Whether there is a trained panoptic field, whose features can be rendered.")
      .def_ro("classes", &Scene::classes,
              "The classes of a bundle; empty for a bare file of surfels, which has no names.")
      .def_ro("instances", &Scene::instances, "The objects of a bundle; empty likewise.")
      .def_ro("recording", &Scene::recording,
              "The cameras that a bundle was made from; None if it does not know them.")
      .def_prop_ro("positions_m", &positions_of, nb::rv_policy::reference_internal,
                   "Centres of the surfels in the world frame, metres: float32 [surfels, 3], "
                   "a view of the scene's own memory that cannot be written to.")
      .def("__repr__", [](const Scene& scene) {
        return "Scene('" + scene.name +
               "', surfels=" + std::to_string(scene.content.surfels->size()) + ")";
      });
}

}  // namespace segsim::python
