#include "worlds/capture/capture_plan.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <sstream>
#include <string>

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"
#include "core/formatted.h"
#include "core/image.h"
#include "core/input/bounds.h"
#include "core/random.h"
#include "sim/ground/ground_limit.h"
#include "sim/ground/ray_scene.h"

namespace segsim::worlds {
namespace {

constexpr float kFloorTolerance_m = 0.1F;
constexpr float kBandTop_m = 1.8F;
/// Distances to obstacles are of interest up to here.
constexpr double kFarFromObstacles_m = 1.0;
/// Rooms are connected if a person, sideways, fits through the door.
constexpr double kPassage_m = 0.2;

/// The floor plan as a grid; cell (x, y) has its centre at low + (x + 0.5, y + 0.5) * cell.
struct FloorPlan {
  glm::dvec2 low_m{0.0};
  double cell_m = 0.05;
  core::Image<std::uint8_t> floor, obstacle;
  core::Image<float> clearance_m;  ///< To the nearest obstacle, at most kFarFromObstacles_m.
  core::Image<std::uint8_t> free;  ///< The area to capture.

  [[nodiscard]] glm::dvec2 centre_m(int x, int y) const {
    return low_m + cell_m * glm::dvec2(x + 0.5, y + 0.5);
  }
};

float longest_side(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
  return std::max({glm::distance(a, b), glm::distance(b, c), glm::distance(c, a)});
}

/// Of all triangles together: a minute's work. A house takes some millions.
constexpr double kMostSamples = 4e9;

/// Calls `visit` with points that cover the triangle at a spacing of at most `step_m`.
template <class Visit>
void sample_triangle(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c, float step_m,
                     const Visit& visit) {
  const float longest = longest_side(a, b, c);
  const int steps = std::max(1, static_cast<int>(std::ceil(longest / step_m)));
  for (int i = 0; i <= steps; ++i) {
    for (int j = 0; i + j <= steps; ++j) {
      const float u = static_cast<float>(i) / static_cast<float>(steps);
      const float v = static_cast<float>(j) / static_cast<float>(steps);
      visit(a + u * (b - a) + v * (c - a));
    }
  }
}

/// Marks floor and obstacles from the triangles.
FloorPlan rasterise(const sim::MeshScene& scene, double cell_m) {
  glm::dvec2 low(std::numeric_limits<double>::max());
  glm::dvec2 high(-low);
  for (const sim::SubMesh& mesh : scene.meshes) {
    for (const glm::vec3& p : mesh.positions_m) {
      if (std::abs(p.z) > kBandTop_m) continue;
      low = glm::min(low, glm::dvec2(p));
      high = glm::max(high, glm::dvec2(p));
    }
  }
  FloorPlan plan;
  plan.cell_m = cell_m;
  if (low.x > high.x) return plan;
  plan.low_m = low - cell_m;
  const glm::dvec2 cells = glm::ceil((high - low) / cell_m) + 2.0;
  sim::require_ground_cells(cells.x, cells.y, scene.name);
  const glm::ivec2 size(cells);
  plan.floor = core::Image<std::uint8_t>(size.x, size.y);
  plan.obstacle = plan.floor;
  double samples = 0.0;
  const auto mark = [&](core::Image<std::uint8_t>& image, const glm::vec3& p) {
    const glm::ivec2 cell(glm::floor((glm::dvec2(p) - plan.low_m) / cell_m));
    if (image.contains(cell.x, cell.y)) image(cell.x, cell.y) = 1;
  };
  for (const sim::SubMesh& mesh : scene.meshes) {
    for (const glm::uvec3& t : mesh.triangles) {
      const glm::vec3& a = mesh.positions_m[t.x];
      const glm::vec3& b = mesh.positions_m[t.y];
      const glm::vec3& c = mesh.positions_m[t.z];
      if (std::min({a.z, b.z, c.z}) > kBandTop_m) continue;
      if (std::max({a.z, b.z, c.z}) < -kFloorTolerance_m) continue;
      const double steps = static_cast<double>(longest_side(a, b, c)) / (0.5 * cell_m);
      samples += 0.5 * steps * steps;
      if (!(samples <= kMostSamples)) {
        throw core::InputError::expected(
            scene.name, core::print("triangles that %g samples cover", kMostSamples),
            core::print("one of %g m", static_cast<double>(longest_side(a, b, c))));
      }
      const glm::vec3 cross = glm::cross(b - a, c - a);
      const bool level = std::abs(cross.z) > 0.9F * glm::length(cross);
      sample_triangle(a, b, c, 0.5F * static_cast<float>(cell_m), [&](const glm::vec3& p) {
        if (p.z > kFloorTolerance_m && p.z < kBandTop_m) {
          mark(plan.obstacle, p);
        } else if (level && std::abs(p.z) <= kFloorTolerance_m) {
          mark(plan.floor, p);
        }
      });
    }
  }
  return plan;
}

void measure_clearance(FloorPlan& plan) {
  const int width = plan.obstacle.width_px();
  const int height = plan.obstacle.height_px();
  plan.clearance_m =
      core::Image<float>(width, height, static_cast<float>(kFarFromObstacles_m));
  const int reach = static_cast<int>(std::ceil(kFarFromObstacles_m / plan.cell_m));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (plan.obstacle(x, y) == 0) continue;
      for (int j = std::max(0, y - reach); j <= std::min(height - 1, y + reach); ++j) {
        for (int i = std::max(0, x - reach); i <= std::min(width - 1, x + reach); ++i) {
          const auto distance_m = static_cast<float>(plan.cell_m * std::hypot(i - x, j - y));
          plan.clearance_m(i, j) = std::min(plan.clearance_m(i, j), distance_m);
        }
      }
    }
  }
}

/// Marks the cells with a floor, enough room, and a ceiling where the scene has one; then
/// keeps the largest connected part.
void find_free_area(const sim::RayScene& rays, FloorPlan& plan) {
  const int width = plan.floor.width_px();
  const int height = plan.floor.height_px();
  plan.free = core::Image<std::uint8_t>(width, height);
  core::Image<std::uint8_t> covered(width, height);
  std::size_t open_cells = 0;
  std::size_t covered_cells = 0;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const bool open =
          plan.floor(x, y) != 0 && static_cast<double>(plan.clearance_m(x, y)) >= kPassage_m;
      if (!open) continue;
      plan.free(x, y) = 1;
      ++open_cells;
      const glm::vec3 start(plan.centre_m(x, y), kBandTop_m);
      if (rays.occluded(start, {0, 0, 1}, 0.0F, sim::RayScene::kFar)) {
        covered(x, y) = 1;
        ++covered_cells;
      }
    }
  }
  // Lamps and beams cover a little of a scene without a ceiling.
  const bool has_ceiling = 2 * covered_cells > open_cells;

  core::Image<int> part(width, height, 0);
  int parts = 0;
  int largest = 0;
  std::size_t largest_size = 0;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (has_ceiling && covered(x, y) == 0) plan.free(x, y) = 0;
    }
  }
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (plan.free(x, y) == 0 || part(x, y) != 0) continue;
      ++parts;
      std::size_t size = 0;
      std::vector<glm::ivec2> stack{{x, y}};
      part(x, y) = parts;
      while (!stack.empty()) {
        const glm::ivec2 cell = stack.back();
        stack.pop_back();
        ++size;
        for (const glm::ivec2 step : {glm::ivec2(1, 0), {-1, 0}, {0, 1}, {0, -1}}) {
          const glm::ivec2 next = cell + step;
          if (!plan.free.contains(next.x, next.y) || plan.free(next.x, next.y) == 0) continue;
          if (part(next.x, next.y) != 0) continue;
          part(next.x, next.y) = parts;
          stack.push_back(next);
        }
      }
      if (size > largest_size) {
        largest = parts;
        largest_size = size;
      }
    }
  }
  for (std::size_t i = 0; i < part.size(); ++i) {
    plan.free.data()[i] = largest > 0 && part.data()[i] == largest ? 1 : 0;
  }
}

/// In every square of a coarse grid, the free cell with the most room around it; of two that
/// are close to each other, the first is kept.
std::vector<glm::dvec2> choose_places(const FloorPlan& plan, const CapturePlan& options) {
  const int square =
      std::max(1, static_cast<int>(std::lround(options.spacing_m / plan.cell_m)));
  std::vector<glm::dvec2> places_m;
  for (int y0 = 0; y0 < plan.free.height_px(); y0 += square) {
    for (int x0 = 0; x0 < plan.free.width_px(); x0 += square) {
      std::optional<glm::dvec2> best;
      double best_score = 0.0;
      for (int y = y0; y < std::min(y0 + square, plan.free.height_px()); ++y) {
        for (int x = x0; x < std::min(x0 + square, plan.free.width_px()); ++x) {
          const auto clearance_m = static_cast<double>(plan.clearance_m(x, y));
          if (plan.free(x, y) == 0 || clearance_m < options.clearance_m) continue;
          // Where there is room everywhere, the middle of the square.
          const double off_m =
              plan.cell_m * std::hypot(x - x0 - 0.5 * square, y - y0 - 0.5 * square);
          const double score = 10.0 + clearance_m - 0.5 * off_m;
          if (score <= best_score) continue;
          best_score = score;
          best = plan.centre_m(x, y);
        }
      }
      const auto too_close = [&](const glm::dvec2& other) {
        return glm::distance(*best, other) < 0.6 * options.spacing_m;
      };
      if (best && std::none_of(places_m.begin(), places_m.end(), too_close)) {
        places_m.push_back(*best);
      }
    }
  }
  return places_m;
}

/// Orders places so that each is followed by the nearest one left.
void order_as_walk(std::vector<glm::dvec2>& places_m) {
  for (std::size_t i = 1; i < places_m.size(); ++i) {
    const auto rest = places_m.begin() + static_cast<std::ptrdiff_t>(i);
    const glm::dvec2 here = *(rest - 1);
    std::iter_swap(rest,
                   std::min_element(rest, places_m.end(), [&](const auto& a, const auto& b) {
                     return glm::distance(a, here) < glm::distance(b, here);
                   }));
  }
}

/// First heading at a place: of eight turns, the one whose views see farthest, each up to 3 m.
double first_heading_rad(const sim::RayScene& rays, const glm::dvec3& eye_m, int views,
                         core::RandomStream& random) {
  const double sector_rad = 2.0 * std::numbers::pi / views;
  const double start_rad = random.uniform(0.0, sector_rad);
  double best_rad = start_rad;
  double best_sum = -1.0;
  for (int turn = 0; turn < 8; ++turn) {
    const double heading_rad = start_rad + sector_rad * turn / 8.0;
    double sum = 0.0;
    for (int view = 0; view < views; ++view) {
      const double yaw_rad = heading_rad + sector_rad * view;
      const glm::vec3 direction(std::cos(yaw_rad), std::sin(yaw_rad), 0.0);
      sum += static_cast<double>(std::min(3.0F, rays.cast(glm::vec3(eye_m), direction).t));
    }
    if (sum > best_sum) {
      best_sum = sum;
      best_rad = heading_rad;
    }
  }
  return best_rad;
}

/// Median distance to what is seen straight ahead and 20 degrees to both sides.
double view_depth_m(const sim::RayScene& rays, const glm::dvec3& eye_m, double yaw_rad) {
  std::array<float, 3> depths_m{};
  for (std::size_t i = 0; i < depths_m.size(); ++i) {
    const double ray_yaw_rad = yaw_rad + 0.35 * (static_cast<double>(i) - 1.0);
    const glm::vec3 direction(std::cos(ray_yaw_rad), std::sin(ray_yaw_rad), 0.0);
    depths_m[i] = rays.cast(glm::vec3(eye_m), direction).t;
  }
  std::sort(depths_m.begin(), depths_m.end());
  return static_cast<double>(depths_m[1]);
}

core::CameraPose camera_at(const glm::dvec3& eye_m, double yaw_rad, double pitch_down_rad) {
  const core::Pose2 base{eye_m.x, eye_m.y, yaw_rad};
  return core::transform_from_pose2<core::frame::World>(base) *
         core::mast_camera(eye_m.z, pitch_down_rad);
}

}  // namespace

std::vector<core::CameraPose> plan_capture_trajectory(const sim::MeshScene& scene,
                                                      const CapturePlan& options) {
  SEGSIM_CHECK(options.spacing_m > 0 && options.cell_m > 0, "spacing");
  SEGSIM_CHECK(options.views_per_place > 0, std::to_string(options.views_per_place));
  SEGSIM_CHECK(!options.heights_m.empty() && !options.pitches_down_rad.empty(), "empty list");
  FloorPlan plan = rasterise(scene, options.cell_m);
  const sim::RayScene rays(scene);
  measure_clearance(plan);
  find_free_area(rays, plan);
  std::vector<glm::dvec2> places_m = choose_places(plan, options);
  if (places_m.empty()) {
    throw core::InputError::expected(scene.name, "free floor at z = 0 for a camera", "none");
  }
  order_as_walk(places_m);

  std::vector<core::CameraPose> poses;
  std::size_t view_number = 0;
  for (std::size_t i = 0; i < places_m.size(); ++i) {
    core::RandomStream random(options.seed, "capture_plan", i);
    const glm::dvec3 eye_m(places_m[i], options.heights_m[i % options.heights_m.size()]);
    const double heading_rad = first_heading_rad(rays, eye_m, options.views_per_place, random);
    for (int view = 0; view < options.views_per_place; ++view, ++view_number) {
      const double yaw_rad =
          heading_rad + 2.0 * std::numbers::pi * view / options.views_per_place;
      if (view_depth_m(rays, eye_m, yaw_rad) < options.min_view_m) continue;
      poses.push_back(
          camera_at(eye_m, yaw_rad,
                    options.pitches_down_rad[view_number % options.pitches_down_rad.size()]));
    }
  }
  if (options.max_views <= 0 || poses.size() <= static_cast<std::size_t>(options.max_views)) {
    return poses;
  }
  // Leave out views evenly: every place keeps some.
  std::vector<core::CameraPose> kept;
  const auto count = static_cast<std::size_t>(options.max_views);
  for (std::size_t i = 0; i < count; ++i) kept.push_back(poses[i * poses.size() / count]);
  return kept;
}

std::vector<core::CameraPose> read_trajectory(const std::filesystem::path& file) {
  std::istringstream lines(core::read_file(file));
  std::vector<core::CameraPose> poses;
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    if (const std::size_t end = line.find_last_not_of(" \t\r"); end == std::string::npos)
      continue;
    if (line[line.find_first_not_of(" \t")] == '#') continue;
    const std::string place = file.string() + ":" + std::to_string(number);
    std::istringstream words(line);
    std::vector<double> values;
    std::string word;
    while (words >> word) {
      char* end = nullptr;
      const double value = std::strtod(word.c_str(), &end);
      if (*end != '\0' || !std::isfinite(value)) {
        throw core::InputError::expected(place, "numbers", "\"" + word + "\"");
      }
      values.push_back(value);
    }
    // Of a TUM line the first number is a time, which nobody looks at.
    for (std::size_t k = values.size() == 8 ? 1 : 0; k < values.size(); ++k) {
      if (core::within_world(values[k])) continue;
      throw core::InputError::expected(place,
                                       core::print("numbers within %g", core::kFarthest_m),
                                       core::print("%g", values[k]));
    }
    if (values.size() == 5) {
      poses.push_back(camera_at({values[0], values[1], values[2]}, values[3], values[4]));
    } else if (values.size() == 8) {
      const glm::dquat rotation(values[7], values[4], values[5], values[6]);
      if (std::abs(glm::length(rotation) - 1.0) > 1e-3) {
        throw core::InputError::expected(place, "a unit quaternion",
                                         "length " + std::to_string(glm::length(rotation)));
      }
      poses.emplace_back(glm::normalize(rotation),
                         glm::dvec3(values[1], values[2], values[3]));
    } else {
      throw core::InputError::expected(place, "5 numbers (x y z yaw pitch_down) or 8 (TUM)",
                                       std::to_string(values.size()));
    }
  }
  if (poses.empty()) throw core::InputError::expected(file.string(), "poses", "none");
  return poses;
}

}  // namespace segsim::worlds
