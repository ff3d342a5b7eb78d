#pragma once

/// @file
/// Navigation mesh (Recast) and queries on it (Detour). World frame with z up on this side;
/// the conversion to the libraries' y-up happens inside.
///
/// Use it for islands, sampling and as a second opinion. Detour's A* measures along edge
/// midpoints and may pass an obstacle on the wrong side; lengths that enter SPL come from
/// sim/ground/distance_field.h.

#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include <glm/vec3.hpp>

#include "core/random.h"
#include "sim/ground/triangle_mesh.h"

namespace segsim::sim {

/// Defaults are habitat-sim's, with finer cells in height.
struct NavmeshSettings {
  double cell_m = 0.05, cell_height_m = 0.05;
  double agent_height_m = 1.25, agent_radius_m = 0.333, max_climb_m = 0.06;
  double max_slope_deg = 45.0;
  double region_min_cells = 20.0, region_merge_cells = 20.0;  ///< Side of the area.
  double edge_max_m = 12.0, edge_max_error_cells = 1.3;
  double detail_sample_cells = 6.0, detail_max_error_cells = 1.0;

  bool operator==(const NavmeshSettings&) const = default;
};

struct NavPoint {
  glm::dvec3 position_m{0.0};
  int island = 0;  ///< 0 is the largest by area.
};

struct NavPath {
  std::vector<glm::dvec3> corners_m;  ///< From the requested start to the requested end.
  double length_m = 0.0;              ///< In 3-D.
};

namespace internal {
struct NavmeshAccess;
}

class Navmesh {
 public:
  /// @throws NoRoom (sim/ground/no_room.h) if the mesh holds no walkable area for these
  /// settings.
  [[nodiscard]] static Navmesh build(const TriangleMesh& mesh,
                                     const NavmeshSettings& settings);
  /// @throws core::InputError: not such a file, another version, cut short.
  [[nodiscard]] static Navmesh load(const std::filesystem::path& file);
  void save(const std::filesystem::path& file) const;

  ~Navmesh();
  Navmesh(Navmesh&&) noexcept;
  Navmesh& operator=(Navmesh&&) noexcept;

  [[nodiscard]] const NavmeshSettings& settings() const;
  [[nodiscard]] int polygon_count() const;
  /// Areas of the connected islands [m^2], in descending order; polygons in plan.
  [[nodiscard]] const std::vector<double>& island_areas_m2() const;

  /// Nearest point of the mesh within `reach_m` in plan and 1 m in height.
  [[nodiscard]] std::optional<NavPoint> nearest(const glm::dvec3& p_m,
                                                double reach_m = 0.5) const;
  /// Uniform by area on one island.
  [[nodiscard]] glm::dvec3 random_point(core::RandomStream& random, int island = 0) const;
  /// nullopt if an end is off the mesh or they lie on different islands.
  [[nodiscard]] std::optional<NavPath> find_path(const glm::dvec3& from_m,
                                                 const glm::dvec3& to_m) const;

 private:
  friend struct internal::NavmeshAccess;
  struct Impl;
  explicit Navmesh(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace segsim::sim
