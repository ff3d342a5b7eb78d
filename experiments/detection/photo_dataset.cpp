#include "experiments/detection/photo_dataset.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

#include "core/check.h"
#include "core/progress.h"
#include "perception/data/image_file.h"

namespace segsim::experiments::detection {
namespace {

namespace fs = std::filesystem;
using reconstruction::AnnotatedBox;
using reconstruction::OrientedBox;

constexpr float kNoHit = std::numeric_limits<float>::quiet_NaN();

struct Ray {
  glm::dvec3 origin_m{0.0}, direction{0.0};  ///< Depth along the camera's +z is the parameter.
};

struct Span {
  double enter_m = 0.0, leave_m = 0.0;
};

/// Part of the ray inside a box, by cutting it with three pairs of planes; nullopt if it
/// misses or begins inside.
std::optional<Span> cut(const Ray& ray, const OrientedBox& box) {
  const double c = std::cos(box.yaw_rad), s = std::sin(box.yaw_rad);
  const glm::dvec3 d = ray.origin_m - box.center_m, v = ray.direction;
  const glm::dvec3 p{d.x * c + d.y * s, d.y * c - d.x * s, d.z};
  const glm::dvec3 u{v.x * c + v.y * s, v.y * c - v.x * s, v.z};
  double enter_m = 0.0, leave_m = std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis) {
    const double half = 0.5 * box.size_m[axis];
    if (std::abs(u[axis]) < 1e-12) {
      if (std::abs(p[axis]) > half) return std::nullopt;
      continue;
    }
    const double a = (-half - p[axis]) / u[axis], b = (half - p[axis]) / u[axis];
    enter_m = std::max(enter_m, std::min(a, b));
    leave_m = std::min(leave_m, std::max(a, b));
  }
  if (enter_m <= 0.0 || leave_m <= enter_m) return std::nullopt;
  return Span{enter_m, leave_m};
}

/// The nearest part of an object.
std::optional<Span> cut(const Ray& ray, const AnnotatedBox& object) {
  if (object.parts.empty()) return cut(ray, object.box);
  std::optional<Span> nearest;
  for (const OrientedBox& part : object.parts) {
    const auto span = cut(ray, part);
    if (span && (!nearest || span->enter_m < nearest->enter_m)) nearest = span;
  }
  return nearest;
}

/// Pixels [x0, x1) x [y0, y1) that can show an object; all if it reaches behind the camera.
struct PixelRect {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
};

PixelRect reach_of(const AnnotatedBox& object, const core::CameraPose& T_world_camera,
                   const core::CameraIntrinsics& camera) {
  const PixelRect all{0, 0, camera.width_px, camera.height_px};
  const auto T_camera_world = T_world_camera.inverse();
  const glm::dvec3 low = object.box.world_min_m(), high = object.box.world_max_m();
  double x0 = 1e9, y0 = 1e9, x1 = -1e9, y1 = -1e9;
  int behind = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const core::Point<core::frame::World> p{{(corner & 1) != 0 ? high.x : low.x,
                                             (corner & 2) != 0 ? high.y : low.y,
                                             (corner & 4) != 0 ? high.z : low.z}};
    const glm::dvec3 q_m = (T_camera_world * p).xyz_m;
    if (q_m.z < 0.05) {
      ++behind;
      continue;
    }
    const glm::dvec2 px = camera.project(q_m);
    x0 = std::min(x0, px.x);
    x1 = std::max(x1, px.x);
    y0 = std::min(y0, px.y);
    y1 = std::max(y1, px.y);
  }
  if (behind == 8) return {};
  if (behind > 0) return all;
  const auto clamp = [](double value, int size) {
    return static_cast<int>(std::clamp(value, 0.0, static_cast<double>(size)));
  };
  return {clamp(std::floor(x0), all.x1), clamp(std::floor(y0), all.y1),
          clamp(std::ceil(x1), all.x1), clamp(std::ceil(y1), all.y1)};
}

/// What the depth camera says about an object at a pixel.
enum class DepthSays : unsigned char { kNothing, kHidden, kFliesOn };

DepthSays ask_depth(double measured_m, const Span& span, double slack_m) {
  if (!(measured_m > 0.0)) return DepthSays::kNothing;
  if (measured_m < span.enter_m - slack_m) return DepthSays::kHidden;
  return measured_m > span.leave_m + slack_m ? DepthSays::kFliesOn : DepthSays::kNothing;
}

double depth_at(const reconstruction::RgbdFrame& frame, int x, int y, int width, int height) {
  if (frame.depth_m.empty()) return 0.0;
  return frame.depth_m(x * frame.depth_m.width_px() / width,
                       y * frame.depth_m.height_px() / height);
}

}  // namespace

PhotoLabels cast_boxes(const reconstruction::RgbdFrame& frame,
                       const core::CameraIntrinsics& camera,
                       const std::vector<AnnotatedBox>& boxes, double depth_slack_m) {
  const int width = camera.width_px, height = camera.height_px;
  PhotoLabels labels;
  labels.instance = core::Image<std::uint16_t>(width, height);
  labels.depth_m = core::Image<float>(width, height, kNoHit);
  std::map<std::uint16_t, int> whole;  // Pixels of an object if nothing hid it.
  for (const AnnotatedBox& object : boxes) {
    if (object.structure) continue;
    const PixelRect reach = reach_of(object, frame.T_world_camera, camera);
    for (int y = reach.y0; y < reach.y1; ++y) {
      for (int x = reach.x0; x < reach.x1; ++x) {
        const Ray ray{
            frame.T_world_camera.translation_m(),
            frame.T_world_camera.rotation() * camera.back_project({x + 0.5, y + 0.5}, 1.0)};
        const auto span = cut(ray, object);
        if (!span) continue;
        const DepthSays says =
            ask_depth(depth_at(frame, x, y, width, height), *span, depth_slack_m);
        if (says == DepthSays::kFliesOn) continue;
        ++whole[object.id];
        if (says == DepthSays::kHidden || labels.depth_m(x, y) <= span->enter_m) continue;
        labels.instance(x, y) = object.id;
        labels.depth_m(x, y) = static_cast<float>(span->enter_m);
      }
    }
  }
  std::map<std::uint16_t, int> visible;
  for (const std::uint16_t id : labels.instance.pixels()) {
    if (id != 0) ++visible[id];
  }
  for (const auto& [id, count] : visible) {
    labels.visible_fraction[id] = static_cast<double>(count) / whole.at(id);
  }
  return labels;
}

fs::path write_photo_dataset(const reconstruction::RgbdSequence& sequence,
                             const reconstruction::BoxAnnotation& annotation,
                             const PhotoOptions& options, const fs::path& folder) {
  SEGSIM_CHECK(options.frame_step > 0, "frame step");
  std::map<std::uint16_t, std::uint16_t> class_of;
  std::map<std::uint16_t, bool> careful;
  for (const core::SceneInstance& instance : annotation.instances) {
    class_of[instance.id] = instance.class_id;
  }
  for (const AnnotatedBox& box : annotation.boxes) careful[box.id] = box.core;

  perception::CocoDataset dataset;
  dataset.folder = folder;
  dataset.class_names = options.class_names;
  core::Progress progress("photographs", static_cast<std::int64_t>(sequence.frame_count()));
  const auto step = static_cast<std::size_t>(options.frame_step);
  for (std::size_t i = 0; i < sequence.frame_count(); i += step) {
    const reconstruction::RgbdFrame frame = sequence.load(i);
    const PhotoLabels labels =
        cast_boxes(frame, sequence.intrinsics(), annotation.boxes, options.depth_slack_m);
    core::Image<std::uint16_t> semantic(labels.instance.width_px(),
                                        labels.instance.height_px());
    for (std::size_t p = 0; p < semantic.size(); ++p) {
      const std::uint16_t id = labels.instance.pixels()[p];
      semantic.pixels()[p] = id == 0 ? std::uint16_t{0} : class_of[id];
    }
    const auto visible_fraction = [&](std::uint16_t id) {
      return labels.visible_fraction.at(id);
    };
    const perception::LabelView view{&semantic, &labels.instance, &labels.depth_m,
                                     visible_fraction};
    perception::LabeledImage image;
    image.id = static_cast<std::int64_t>(i) + 1;
    image.file = "images/" + frame.name + ".png";
    image.width_px = semantic.width_px();
    image.height_px = semantic.height_px();
    image.scene = sequence.name();
    image.boxes =
        perception::label_boxes(view, annotation.classes, options.class_names, options.boxes);
    for (perception::LabeledBox& box : image.boxes) {
      box.ignore |= !careful[static_cast<std::uint16_t>(*box.instance_id)];
    }
    perception::write_image(folder / image.file, frame.rgb);
    dataset.images.push_back(std::move(image));
    progress.update(static_cast<std::int64_t>(i + 1));
  }
  perception::write_coco(folder / "labels.json", dataset);
  return folder / "labels.json";
}

}  // namespace segsim::experiments::detection
