#include "renderer/scene/room_scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/mat3x3.hpp>

#include "core/check.h"
#include "core/random.h"

namespace segsim::renderer {
namespace {

using core::RandomStream;

constexpr double kNearWallShare = 0.8;     // Of boxes that stand along a wall.
constexpr double kWallGap_m = 0.05;        // Between such a box and its wall.
constexpr double kRoughness_m = 0.004;     // Noise of all surfels along the normal.
constexpr double kFloaterShare = 0.2;      // Of surfels that are off their surface.
constexpr double kFloaterOffset_m = 0.03;  // Standard deviation.
constexpr double kScaleSpread = 0.6;       // Of the logarithm of a scale.
constexpr double kTilt = 0.15;             // Tangent of the tilt, standard deviation.
constexpr double kOpaqueShare = 0.6;
constexpr double kMinRoomOpacity = 0.006, kMaxRoomOpacity = 0.995;
constexpr double kFeatureNoise = 0.1;

/// A rectangle that surfels lie on.
struct Quad {
  glm::dvec3 corner_m, u_m, v_m;
  int box;  ///< -1: the shell.
  std::uint16_t semantic;
};

struct Box {
  glm::dvec3 min_m, size_m;
};

std::vector<Box> make_boxes(RandomStream& random) {
  std::vector<Box> boxes;
  for (int i = 0; i < kRoomBoxes; ++i) {
    Box box{};
    box.size_m = {random.uniform(0.3, 1.4), random.uniform(0.3, 0.9),
                  random.uniform(0.3, 1.6)};
    const double x = random.uniform(), y = random.uniform();
    box.min_m = {x * (kRoomSize_m.x - box.size_m.x), y * (kRoomSize_m.y - box.size_m.y), 0.0};
    const std::uint32_t wall = random.index(4);
    if (random.chance(kNearWallShare)) {
      const int axis = static_cast<int>(wall / 2);
      box.min_m[axis] =
          wall % 2 == 0 ? kWallGap_m : kRoomSize_m[axis] - box.size_m[axis] - kWallGap_m;
    }
    boxes.push_back(box);
  }
  return boxes;
}

void add_faces(const Box& box, int index, std::vector<Quad>& quads) {
  for (int a = 0; a < 3; ++a) {
    const int b = (a + 1) % 3, c = (a + 2) % 3;
    for (int side = 0; side < 2; ++side) {
      Quad quad{box.min_m, glm::dvec3(0.0), glm::dvec3(0.0), index, 0};
      quad.corner_m[a] += box.size_m[a] * side;
      quad.u_m[b] = box.size_m[b];
      quad.v_m[c] = box.size_m[c];
      if (index >= 0) {
        quad.semantic =
            static_cast<std::uint16_t>(kRoomFirstBoxClass + index % kRoomBoxClasses);
      } else {
        quad.semantic = a != 2        ? kRoomWallClass
                        : (side == 0) ? kRoomFloorClass
                                      : kRoomCeilingClass;
      }
      quads.push_back(quad);
    }
  }
}

std::vector<Quad> make_quads(std::uint64_t seed, int room) {
  RandomStream random(seed, "room_scene.boxes", static_cast<std::uint64_t>(room));
  std::vector<Quad> quads;
  add_faces({glm::dvec3(0.0), kRoomSize_m}, -1, quads);
  const std::vector<Box> boxes = make_boxes(random);
  for (int i = 0; i < kRoomBoxes; ++i) add_faces(boxes[static_cast<std::size_t>(i)], i, quads);
  return quads;
}

double area_m2(const Quad& quad) { return glm::length(glm::cross(quad.u_m, quad.v_m)); }

/// Running sums of the quads' areas.
std::vector<double> running_areas(const std::vector<Quad>& quads) {
  std::vector<double> sums;
  sums.reserve(quads.size());
  double sum = 0.0;
  for (const Quad& quad : quads) sums.push_back(sum += area_m2(quad));
  return sums;
}

/// Gamma variate of shape >= 1 and scale 1 (Marsaglia & Tsang 2000).
double gamma_variate(RandomStream& random, double shape) {
  const double d = shape - 1.0 / 3.0;
  const double c = 1.0 / std::sqrt(9.0 * d);
  while (true) {
    const double x = random.normal();
    const double t = 1.0 + c * x;
    if (t <= 0.0) continue;
    const double v = t * t * t;
    const double u = 1.0 - random.uniform();  // (0, 1]
    if (std::log(u) < 0.5 * x * x + d - d * v + d * std::log(v)) return d * v;
  }
}

double beta_variate(RandomStream& random, double a, double b) {
  const double x = gamma_variate(random, a);
  return x / (x + gamma_variate(random, b));
}

/// Position of room `index` on a square spiral about (0, 0).
glm::ivec2 spiral(int index) {
  int x = 0, y = 0, dx = 1, dy = 0, run = 1;
  for (int done = 0; done < index;) {
    for (int turn = 0; turn < 2; ++turn) {
      for (int step = 0; step < run && done < index; ++step, ++done) {
        x += dx;
        y += dy;
      }
      const int old_dx = dx;
      dx = -dy;
      dy = old_dx;
    }
    ++run;
  }
  return {x, y};
}

/// What the surfels of one room have in common.
struct Room {
  std::vector<Quad> quads;
  std::vector<double> areas;
  glm::dmat3 colour_wave{0.0};
  std::vector<core::SemanticFeature> semantic_mean;  ///< Of the shell, then of each box.
  std::vector<core::InstanceFeature> instance_mean;
  glm::dvec3 corner_m{0.0};
  int index = 0;
  double scale_m = 0.0;
};

template <class Feature>
Feature random_feature(RandomStream& random, const Feature& mean, double deviation) {
  Feature feature = mean;
  for (float& value : feature) value += static_cast<float>(deviation * random.normal());
  return feature;
}

Room make_room(const RoomSceneOptions& options, int index) {
  Room room;
  room.index = index;
  room.quads = make_quads(options.seed, index);
  room.areas = running_areas(room.quads);
  room.scale_m = options.spread * std::sqrt(room.areas.back() / options.surfel_count);
  const glm::ivec2 cell = spiral(index);
  room.corner_m = {cell.x * (kRoomSize_m.x + kRoomWall_m),
                   cell.y * (kRoomSize_m.y + kRoomWall_m), 0.0};
  RandomStream random(options.seed, "room_scene.colours", static_cast<std::uint64_t>(index));
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) room.colour_wave[i][j] = 3.0 * random.normal();
  }
  for (int i = 0; options.features && i <= kRoomBoxes; ++i) {
    room.semantic_mean.push_back(random_feature(random, core::SemanticFeature{}, 1.0));
    room.instance_mean.push_back(random_feature(random, core::InstanceFeature{}, 1.0));
  }
  return room;
}

/// Unit tangents and normal of a quad, turned by a random angle and slightly tilted.
glm::quat random_orientation(RandomStream& random, const Quad& quad) {
  const glm::dvec3 u = glm::normalize(quad.u_m), v = glm::normalize(quad.v_m);
  const double angle_rad = random.uniform(0.0, 2.0 * std::numbers::pi);
  const double tilt_u = kTilt * random.normal(), tilt_v = kTilt * random.normal();
  const glm::dvec3 normal = glm::normalize(glm::cross(u, v) + tilt_u * u + tilt_v * v);
  glm::dvec3 t_u = u * std::cos(angle_rad) + v * std::sin(angle_rad);
  t_u = glm::normalize(t_u - normal * glm::dot(t_u, normal));
  return glm::quat(
      glm::normalize(glm::quat_cast(glm::dmat3(t_u, glm::cross(normal, t_u), normal))));
}

float random_opacity(RandomStream& random) {
  const double opacity = random.chance(kOpaqueShare) ? beta_variate(random, 8.0, 1.5)
                                                     : beta_variate(random, 1.2, 3.0);
  return static_cast<float>(std::clamp(opacity, kMinRoomOpacity, kMaxRoomOpacity));
}

glm::vec3 random_colour(RandomStream& random, const Room& room, const glm::dvec3& p_m,
                        int box) {
  glm::vec3 colour;
  for (int j = 0; j < 3; ++j) {
    const double phase = p_m.x * room.colour_wave[0][j] + p_m.y * room.colour_wave[1][j] +
                         p_m.z * room.colour_wave[2][j] + (box + 1);
    const double value = 0.5 + 0.35 * std::sin(phase) + 0.05 * random.normal();
    colour[j] = static_cast<float>(std::clamp(value, 0.0, 1.0));
  }
  return colour;
}

void add_surfel(const Room& room, const RoomSceneOptions& options, int i, SurfelCloud& cloud) {
  // A stream for each surfel: rejected draws of one never shift another.
  const auto stream = (static_cast<std::uint64_t>(room.index) << 32U) |
                      static_cast<std::uint64_t>(static_cast<std::uint32_t>(i));
  RandomStream random(options.seed, "room_scene.surfel", stream);
  const auto at = std::upper_bound(room.areas.begin(), room.areas.end() - 1,
                                   random.uniform() * room.areas.back());
  const Quad& quad = room.quads[static_cast<std::size_t>(at - room.areas.begin())];
  const double s = random.uniform(), t = random.uniform();
  double offset_m = kRoughness_m * random.normal();
  if (random.chance(kFloaterShare)) offset_m += kFloaterOffset_m * random.normal();
  const glm::dvec3 p_m = quad.corner_m + s * quad.u_m + t * quad.v_m +
                         offset_m * glm::normalize(glm::cross(quad.u_m, quad.v_m));
  const double su = std::exp(kScaleSpread * random.normal());
  const double sv = std::exp(kScaleSpread * random.normal());

  cloud.position_m.emplace_back(p_m + room.corner_m);
  cloud.scale_m.emplace_back(room.scale_m * su, room.scale_m * sv);
  cloud.R_world_surfel.push_back(random_orientation(random, quad));
  cloud.opacity.push_back(random_opacity(random));
  cloud.sh.push_back((random_colour(random, room, p_m, quad.box) - 0.5F) / kShC0);
  cloud.semantic_id.push_back(quad.semantic);
  cloud.instance_id.push_back(
      quad.box < 0 ? std::uint16_t{0}
                   : static_cast<std::uint16_t>(1 + quad.box + kRoomBoxes * room.index));
  if (!options.features) return;
  const auto mean = static_cast<std::size_t>(quad.box + 1);
  cloud.semantic_feature.push_back(
      random_feature(random, room.semantic_mean[mean], kFeatureNoise));
  cloud.instance_feature.push_back(
      random_feature(random, room.instance_mean[mean], kFeatureNoise));
}

}  // namespace

SurfelCloud make_room_scene(const RoomSceneOptions& options) {
  SEGSIM_CHECK(options.surfel_count > 0,
               "surfel_count = " + std::to_string(options.surfel_count));
  SEGSIM_CHECK(options.spread > 0.0 && std::isfinite(options.spread),
               "spread = " + std::to_string(options.spread));
  SEGSIM_CHECK(options.rooms >= 1 && options.rooms <= 1000,
               "rooms = " + std::to_string(options.rooms));
  SurfelCloud cloud;
  const auto total =
      static_cast<std::size_t>(options.surfel_count) * static_cast<std::size_t>(options.rooms);
  cloud.position_m.reserve(total);
  cloud.R_world_surfel.reserve(total);
  cloud.scale_m.reserve(total);
  cloud.opacity.reserve(total);
  cloud.sh.reserve(total);
  cloud.semantic_id.reserve(total);
  cloud.instance_id.reserve(total);
  for (int index = 0; index < options.rooms; ++index) {
    const Room room = make_room(options, index);
    for (int i = 0; i < options.surfel_count; ++i) add_surfel(room, options, i, cloud);
  }
  return cloud;
}

core::CameraIntrinsics room_camera(int width_px, int height_px) {
  const double focal_px = 1165.7 * width_px / 1296.0;
  return {width_px, height_px, focal_px, focal_px, 0.5 * width_px, 0.5 * height_px};
}

std::vector<core::CameraPose> room_camera_ring(int count) {
  std::vector<core::CameraPose> ring;
  for (int i = 0; i < count; ++i) {
    const double a = 2.0 * std::numbers::pi * i / count;
    const glm::dvec3 middle_m = 0.5 * kRoomSize_m;
    ring.push_back(
        core::look_at({middle_m.x + 2.6 * std::cos(a), middle_m.y + 1.8 * std::sin(a), 1.3},
                      {middle_m.x - 2.0 * std::cos(a), middle_m.y - 1.4 * std::sin(a), 0.9}));
  }
  return ring;
}

}  // namespace segsim::renderer
