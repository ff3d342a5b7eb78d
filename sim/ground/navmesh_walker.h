#pragma once

/// @file
/// A point that moves on the navigation mesh the way Habitat's agent does: the mesh is eroded
/// by the robot's radius, so the point may go wherever there is mesh; heading and shape do not
/// matter. Rule of the step filter (habitat-sim 57ee494, src/esp/nav/PathFinder.cpp, read for
/// its behaviour):
///
///     slide      as far as the mesh goes, and on along its edge (moveAlongSurface)
///     stop       to the first edge that the straight way meets (raycast)
///
/// Discrete actions of that agent: a straight step of 0.25 m through this filter, and turns on
/// the spot that never collide.

#include <memory>
#include <optional>

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "core/frames.h"
#include "sim/ground/collision.h"
#include "sim/ground/navmesh.h"

namespace segsim::sim {

class NavmeshWalker {
 public:
  /// Habitat's way to a place: the nearest one on the mesh within 2 m in plan, 4 m in height;
  /// nullopt if there is none. One walker serves one thread; the navmesh outlives it.
  [[nodiscard]] static std::optional<NavmeshWalker> place(const Navmesh& navmesh,
                                                          const glm::dvec3& p_m);
  ~NavmeshWalker();
  NavmeshWalker(NavmeshWalker&&) noexcept;
  NavmeshWalker& operator=(NavmeshWalker&&) noexcept;

  struct Step {
    glm::dvec3 position_m{0.0};
    /// Of the edge that was met, in plan and towards the mesh; none on open floor.
    std::optional<glm::dvec2> wall_normal;
    /// Habitat's collision: the step came out shorter (squared lengths, 1e-5 m^2).
    bool shortened = false;
  };
  /// Goes towards a place in plan.
  Step walk(const glm::dvec2& towards_m, ContactResponse response);
  [[nodiscard]] const glm::dvec3& position_m() const;

 private:
  struct Impl;
  explicit NavmeshWalker(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace segsim::sim
