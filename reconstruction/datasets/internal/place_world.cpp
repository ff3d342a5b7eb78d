#include "reconstruction/datasets/internal/place_world.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <utility>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>

#include "reconstruction/datasets/floor_fit.h"
#include "reconstruction/datasets/internal/depth_files.h"

namespace segsim::reconstruction::internal {
namespace {

using WorldTransform = core::Transform<core::frame::World, core::frame::World>;

constexpr double kDegree = std::numbers::pi / 180.0;
/// A layout's axis this close to the evidence is as good: the surface is levelled anyway.
constexpr double kSameUp_rad = 1.0 * kDegree;
constexpr double kSameFloor_m = 0.1;
constexpr double kLowestCarried_m = 0.15, kHighestCarried_m = 5.0;
constexpr double kFarthest_m = 6.0;  ///< Depth beyond tells little.

glm::dvec3 axis_of(UpAxis up) {
  return up == UpAxis::kY ? glm::dvec3(0.0, 1.0, 0.0) : glm::dvec3(0.0, 0.0, 1.0);
}

/// Source world -> our world, without the floor.
WorldTransform turn_axis(UpAxis up) {
  if (up == UpAxis::kZ) return {};
  // (x, y, z) -> (x, -z, y): a quarter turn about x.
  return {glm::dquat(std::sqrt(0.5), std::sqrt(0.5), 0.0, 0.0), glm::dvec3(0.0)};
}

/// The same for any direction. The world's x points where the camera looks: turning a
/// recording leaves its scene as it was.
WorldTransform turn_direction(const glm::dvec3& up, const core::CameraPose& camera) {
  const auto level = [&](const glm::dvec3& v) { return v - glm::dot(v, up) * up; };
  glm::dvec3 ahead = level(camera.rotation() * glm::dvec3(0.0, 0.0, 1.0));
  if (glm::length(ahead) < 0.1) ahead = level(camera.rotation() * glm::dvec3(0.0, -1.0, 0.0));
  const glm::dvec3 x = glm::normalize(ahead);
  return {glm::normalize(glm::quat_cast(glm::transpose(glm::dmat3(x, glm::cross(up, x), up)))),
          glm::dvec3(0.0)};
}

bool has_depth(const FrameFiles& frame) {
  return !frame.depth_png.empty() || !frame.depth_exr.empty();
}

/// Calls `use` with the world points of every `step(width)`-th pixel of evenly spread frames.
template <class Step, class Use>
void sample_depth(const SequenceParts& parts, std::size_t most_frames, const Step& step_of,
                  const Use& use) {
  const std::size_t frames = std::min(most_frames, parts.frames.size());
  for (std::size_t k = 0; k < frames; ++k) {
    const FrameFiles& frame = parts.frames[k * parts.frames.size() / frames];
    const core::Image<float> depth_m = read_depth(frame, parts);
    if (depth_m.empty()) continue;
    const core::CameraIntrinsics camera =
        parts.intrinsics.resized(depth_m.width_px(), depth_m.height_px());
    const int step = step_of(depth_m.width_px());
    for (int y = step / 2; y < depth_m.height_px(); y += step) {
      for (int x = step / 2; x < depth_m.width_px(); x += step) {
        const double z = depth_m(x, y);
        if (!(z > 0.0 && z < kFarthest_m)) continue;
        const core::Point<core::frame::Camera> p{camera.back_project({x + 0.5, y + 0.5}, z)};
        use(glm::vec3((frame.T_world_camera * p).xyz_m),
            glm::vec3(frame.T_world_camera.translation_m()));
      }
    }
  }
}

/// World points of every 8th pixel of a dozen frames.
std::vector<glm::vec3> floor_points(const SequenceParts& parts) {
  std::vector<glm::vec3> points_m;
  sample_depth(
      parts, 16, [](int) { return 8; },
      [&](const glm::vec3& p_m, const glm::vec3&) { points_m.push_back(p_m); });
  return points_m;
}

std::vector<glm::vec3> turned(const std::vector<glm::vec3>& points_m,
                              const WorldTransform& T_turned_source) {
  std::vector<glm::vec3> result;
  result.reserve(points_m.size());
  for (const glm::vec3& p_m : points_m) {
    result.emplace_back((T_turned_source * core::Point<core::frame::World>{p_m}).xyz_m);
  }
  return result;
}

/// A scanned cloud does not say from where its points were seen: from the nearest camera.
std::vector<SeenPoint> seen_cloud(const std::vector<glm::vec3>& points_m,
                                  const SequenceParts& parts) {
  constexpr std::size_t kMostCameras = 100;
  std::vector<glm::vec3> cameras_m;
  const std::size_t step = parts.frames.size() / kMostCameras + 1;
  for (std::size_t i = 0; i < parts.frames.size(); i += step) {
    cameras_m.emplace_back(parts.frames[i].T_world_camera.translation_m());
  }
  std::vector<SeenPoint> seen;
  for (const glm::vec3& p_m : points_m) {
    const auto nearest = std::min_element(
        cameras_m.begin(), cameras_m.end(), [&](const glm::vec3& a, const glm::vec3& b) {
          return glm::distance(a, p_m) < glm::distance(b, p_m);
        });
    seen.push_back({p_m, *nearest});
  }
  return seen;
}

/// Patches of surface in the source's world: of the depth, else of the cloud.
std::vector<SurfaceElement> elements_of(const SequenceParts& parts,
                                        const WorldConvention& convention, bool any_depth) {
  if (!any_depth) return surface_elements(seen_cloud(convention.floor_points_m, parts));
  constexpr std::size_t kFrames = 48;
  constexpr int kColumns = 80;
  std::vector<SeenPoint> seen;
  sample_depth(
      parts, kFrames, [](int width_px) { return std::max(1, width_px / kColumns); },
      [&](const glm::vec3& p_m, const glm::vec3& from_m) {
        seen.push_back({p_m, from_m});
      });
  return surface_elements(seen);
}

double angle_rad(const glm::dvec3& a, const glm::dvec3& b) {
  return std::acos(std::clamp(glm::dot(a, b), -1.0, 1.0));
}

/// Not enough to contradict the layout, and too much to say nothing.
void doubt_up(const glm::dvec3& up, const glm::dvec3& axis, const char* why,
              std::vector<std::string>& warnings) {
  constexpr double kDoubtful_rad = 20.0 * kDegree;
  if (angle_rad(up, axis) < kDoubtful_rad) return;
  char text[256];
  std::snprintf(text, sizeof text,
                "up may be %.0f deg off the layout's axis, but %s; if the scene lies on its "
                "side, try --gravity %.3f %.3f %.3f",
                angle_rad(up, axis) / kDegree, why, -up.x, -up.y, -up.z);
  warnings.emplace_back(text);
}

/// Replaces the layout's axis by what surfaces and cameras say, if they are sure of another
/// direction; warns if they doubt it.
void find_up(const std::vector<SurfaceElement>& elements, SequenceParts& parts) {
  constexpr std::size_t kEnoughToDoubt = 150;
  WorldPlacement& placement = parts.placement;
  std::vector<core::CameraPose> cameras;
  for (const FrameFiles& frame : parts.frames) cameras.push_back(frame.T_world_camera);
  placement.gravity = find_gravity(elements, cameras);
  if (elements.empty()) {
    const auto up = up_of_cameras(cameras);
    if (up) doubt_up(*up, placement.up, "cameras alone say so", parts.warnings);
  } else if (placement.gravity && placement.gravity->sure()) {
    if (angle_rad(placement.gravity->up, placement.up) <= kSameUp_rad) return;
    placement.up = placement.gravity->up;
    placement.up_source = UpSource::kEvidence;
  } else if (placement.gravity && placement.gravity->elements >= kEnoughToDoubt) {
    doubt_up(placement.gravity->up, placement.up, "the evidence is weak", parts.warnings);
  }
}

/// The old and simple rule: the lowest plane with nothing below. None that is above the
/// cameras.
std::optional<double> lowest_plane(const SequenceParts& parts,
                                   const std::vector<glm::vec3>& points_m) {
  const auto height_m = fit_floor_height_m(points_m);
  if (!height_m) return std::nullopt;
  const auto above =
      std::count_if(parts.frames.begin(), parts.frames.end(), [&](const FrameFiles& frame) {
        return frame.T_world_camera.translation_m().z > *height_m;
      });
  return 2 * static_cast<std::size_t>(above) > parts.frames.size() ? height_m : std::nullopt;
}

/// Nobody carries a camera at 15 cm or at 15 m.
void doubt_scale(std::vector<double> cameras_m, double floor_m,
                 std::vector<std::string>& warnings) {
  const auto middle = cameras_m.begin() + static_cast<std::ptrdiff_t>(cameras_m.size() / 2);
  std::nth_element(cameras_m.begin(), middle, cameras_m.end());
  const double height_m = *middle - floor_m;
  if (height_m > kLowestCarried_m && height_m < kHighestCarried_m) return;
  char text[160];
  std::snprintf(text, sizeof text,
                "cameras are %.3g m above the floor: are poses in metres, and depth in the "
                "unit of the layout?",
                height_m);
  warnings.emplace_back(text);
}

/// Decides about the floor of a recording that is turned up already; so are the elements.
/// @param points_m  Turned up, too: of the depth or the cloud.
void find_floor(const std::vector<SurfaceElement>& elements,
                const std::vector<glm::vec3>& points_m, SequenceParts& parts) {
  WorldPlacement& placement = parts.placement;
  std::vector<double> cameras_m;
  for (const FrameFiles& frame : parts.frames) {
    cameras_m.push_back(frame.T_world_camera.translation_m().z);
  }
  placement.floor = find_floor_evidence(elements, cameras_m);
  const bool seen = placement.floor && !placement.floor->guessed;
  const auto lowest_m = lowest_plane(parts, points_m);
  // Where both agree, the plane through points is finer than the one through patches.
  if (lowest_m && (!seen || std::abs(*lowest_m - placement.floor->height_m) <= kSameFloor_m)) {
    if (!seen) placement.floor.reset();
    placement.floor_height_m = *lowest_m;
    placement.floor_source = FloorSource::kFitted;
    if (!seen) doubt_scale(std::move(cameras_m), *lowest_m, parts.warnings);
    return;
  }
  if (!placement.floor) {
    parts.warnings.emplace_back(
        "no floor found below the cameras: source heights are kept (--floor-height M sets "
        "it)");
    return;
  }
  placement.floor_height_m = placement.floor->height_m;
  placement.floor_source = seen ? FloorSource::kFitted : FloorSource::kGuessed;
  if (!seen) {
    parts.warnings.emplace_back(
        "the floor was not seen: its height is guessed from where walls end (--floor-height M "
        "sets it)");
  }
}

void move(const WorldTransform& T_to_from, std::vector<SurfaceElement>& elements) {
  for (SurfaceElement& element : elements) {
    element.position_m =
        (T_to_from * core::Point<core::frame::World>{element.position_m}).xyz_m;
    element.normal = T_to_from.rotation() * element.normal;
  }
}

void move(const WorldTransform& T_to_from, std::vector<FrameFiles>& frames) {
  for (FrameFiles& frame : frames) frame.T_world_camera = T_to_from * frame.T_world_camera;
}

}  // namespace

void place_world(SequenceParts& parts, const WorldConvention& convention) {
  WorldPlacement& placement = parts.placement;
  const bool any_depth = std::any_of(parts.frames.begin(), parts.frames.end(), has_depth);
  const bool up_known = convention.gravity || convention.up_given || !convention.fit_floor;
  const bool floor_known = convention.floor_height_m || !convention.fit_floor;
  std::vector<SurfaceElement> elements;
  if (!up_known || !floor_known) elements = elements_of(parts, convention, any_depth);

  placement.up =
      convention.gravity ? -glm::normalize(*convention.gravity) : axis_of(convention.up);
  placement.up_source = up_known ? UpSource::kGiven : UpSource::kLayout;
  if (!up_known) find_up(elements, parts);
  const bool is_axis = !convention.gravity && placement.up_source != UpSource::kEvidence;
  const WorldTransform T_turned_source =
      is_axis ? turn_axis(convention.up)
              : turn_direction(placement.up, parts.frames.front().T_world_camera);
  move(T_turned_source, parts.frames);
  move(T_turned_source, elements);

  if (floor_known) {
    placement.floor_height_m = convention.floor_height_m.value_or(0.0);
    placement.floor_source = FloorSource::kGiven;
  } else if (any_depth) {
    find_floor(elements, floor_points(parts), parts);
  } else if (!convention.floor_points_m.empty()) {
    find_floor(elements, turned(convention.floor_points_m, T_turned_source), parts);
  } else {
    parts.warnings.emplace_back(
        "no depth images: source heights are kept (--floor-height M sets it), and the frames "
        "cannot be lifted");
  }
  const WorldTransform T_world_turned{glm::dquat(1.0, 0.0, 0.0, 0.0),
                                      {0.0, 0.0, -placement.floor_height_m}};
  move(T_world_turned, parts.frames);
  move(T_world_turned, elements);
  parts.T_world_source = T_world_turned * T_turned_source;
  placement.elements = std::move(elements);
  parts.notes.push_back(describe(placement));
}

}  // namespace segsim::reconstruction::internal
