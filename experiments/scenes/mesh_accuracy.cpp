#include "experiments/scenes/mesh_accuracy.h"

#include <algorithm>
#include <cstdio>
#include <vector>

#include "core/error.h"
#include "sim/ground/ground_grid.h"
#include "sim/ground/navmesh.h"
#include "sim/ground/world.h"
#include "worlds/surface/mesh_cleaning.h"
#include "worlds/surface/mesh_distance.h"

namespace segsim::experiments::scenes {
namespace {

double share(std::size_t part, std::size_t whole) {
  return whole == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
}

bool on_largest_island(const sim::Navmesh& navmesh, const glm::dvec2& p_m) {
  constexpr double kReach_m = 0.01;  // Of the libraries' rounding.
  const auto nearest = navmesh.nearest({p_m.x, p_m.y, 0.0}, kReach_m);
  return nearest && nearest->island == 0;
}

void measure_distance(const sim::TriangleMesh& found, const sim::TriangleMesh& truth,
                      const MeshAccuracyOptions& options, MeshAccuracy& result) {
  const worlds::MeshDistance distance(truth);
  std::vector<double> distances_m;
  for (const glm::vec3& p : worlds::sample_surface(found, options.spacing_m).points_m) {
    const auto z_m = static_cast<double>(p.z);
    if (z_m >= options.z_lo_m && z_m <= options.z_hi_m)
      distances_m.push_back(distance.to_m(p));
  }
  if (distances_m.empty()) {
    throw core::InputError::expected("collision mesh", "surfaces above the floor", "none");
  }
  result.samples = distances_m.size();
  for (const double d : distances_m) result.mean_m += d / static_cast<double>(result.samples);
  const auto rank =
      distances_m.begin() + static_cast<std::ptrdiff_t>(19 * (result.samples - 1) / 20);
  std::nth_element(distances_m.begin(), rank, distances_m.end());
  result.percentile95_m = *rank;
}

}  // namespace

double MeshAccuracy::free_agreement() const {
  return share(free_both, free_truth + free_found - free_both);
}
double MeshAccuracy::free_missed() const { return share(free_truth - free_both, free_truth); }
double MeshAccuracy::free_invented() const {
  return share(free_found - free_both, free_found);
}

std::string MeshAccuracy::text() const {
  char line[400];
  std::snprintf(
      line, sizeof line,
      "surface        mean %.1f mm, 95 %% within %.1f mm of the true one (%zu points, "
      "%zu triangles)\nfree floor     %.1f %% agree (%zu cells true, %zu found); "
      "%.1f %% missed, %.1f %% invented\n",
      1e3 * mean_m, 1e3 * percentile95_m, samples, triangles, 100.0 * free_agreement(),
      free_truth, free_found, 100.0 * free_missed(), 100.0 * free_invented());
  return line;
}

core::MeasurementRecord MeshAccuracy::record(const std::string& case_name) const {
  return {"Collision mesh against the true world",
          false,
          {{case_name, "mean error", "mm", 1e3 * mean_m},
           {case_name, "95 % of the error", "mm", 1e3 * percentile95_m},
           {case_name, "free floor agrees", "%", 100.0 * free_agreement()},
           {case_name, "missed", "%", 100.0 * free_missed()},
           {case_name, "invented", "%", 100.0 * free_invented()},
           {case_name, "triangles", "", static_cast<double>(triangles)}}};
}

MeshAccuracy mesh_accuracy(const sim::TriangleMesh& found, const sim::TriangleMesh& truth,
                           const sim::RobotModel& robot, const MeshAccuracyOptions& options) {
  MeshAccuracy result;
  result.triangles = found.triangles.size();
  measure_distance(found, truth, options, result);
  const sim::NavmeshSettings settings = sim::navmesh_settings_for(robot);
  const sim::Navmesh true_navmesh = sim::Navmesh::build(truth, settings);
  const sim::Navmesh found_navmesh = sim::Navmesh::build(found, settings);
  const sim::GridFrame frame = sim::grid_over(truth, options.cell_m, 0.5);
  for (int j = 0; j < frame.height; ++j) {
    for (int i = 0; i < frame.width; ++i) {
      const bool is_true = on_largest_island(true_navmesh, frame.center_m(i, j));
      const bool is_found = on_largest_island(found_navmesh, frame.center_m(i, j));
      result.free_truth += is_true ? 1 : 0;
      result.free_found += is_found ? 1 : 0;
      result.free_both += is_true && is_found ? 1 : 0;
    }
  }
  return result;
}

}  // namespace segsim::experiments::scenes
