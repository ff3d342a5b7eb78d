#include "sim/ground/navmesh_walker.h"

#include <array>
#include <cmath>
#include <cstdint>

#include <recastnavigation/DetourNavMesh.h>
#include <recastnavigation/DetourNavMeshQuery.h>
#include <glm/geometric.hpp>

#include "core/check.h"
#include "core/error.h"
#include "core/input/bounds.h"
#include "sim/ground/internal/navmesh_access.h"

namespace segsim::sim {
namespace {

using internal::to_y_up;
using internal::to_z_up;
using internal::Xyz;

constexpr int kMaxNodes = 512;  ///< Polygons that one step may touch.
constexpr int kMaxVisited = 64;
constexpr double kShorter_m2 = 1e-5;  ///< hl: the filter "collided".
/// A point on an edge is kept this far inside, or the next step could begin behind a wall
/// without thickness.
constexpr double kInside_m = 1e-4;

struct FreeQuery {
  void operator()(dtNavMeshQuery* query) const { dtFreeNavMeshQuery(query); }
};

}  // namespace

struct NavmeshWalker::Impl {
  std::unique_ptr<dtNavMeshQuery, FreeQuery> query;
  dtQueryFilter filter;
  dtPolyRef polygon = 0;
  glm::dvec3 position_m{0.0};

  /// As far as the straight way leads. @return  Normal of the edge that was met.
  std::optional<glm::dvec2> stop_at_edge(const glm::dvec2& towards_m) {
    const glm::dvec3 from_m = position_m;
    const glm::dvec2 way_m = towards_m - glm::dvec2(from_m);
    float share = 0.0F;
    Xyz normal{};
    std::array<dtPolyRef, kMaxVisited> visited{};
    int count = 0;
    const dtStatus status =
        query->raycast(polygon, to_y_up(from_m).data(), to_y_up({towards_m, from_m.z}).data(),
                       &filter, &share, normal.data(), visited.data(), &count, kMaxVisited);
    if (dtStatusFailed(status) || count == 0) return glm::normalize(-way_m);
    const bool met_edge = share <= 1.0F;  // FLT_MAX: nothing in the way.
    const double inside = kInside_m / glm::length(way_m);
    const double part = met_edge ? std::max(0.0, static_cast<double>(share) - inside) : 1.0;
    Xyz end = to_y_up({glm::dvec2(from_m) + part * way_m, from_m.z});
    settle(visited[static_cast<std::size_t>(count) - 1], end);
    if (!met_edge) return std::nullopt;
    const glm::dvec2 plan(normal[0], -normal[2]);
    // Detour leaves the normal out where the way begins on the edge: straight back, then.
    return glm::normalize(glm::length(plan) > 1e-6 ? plan : -way_m);
  }

  /// To the place on the mesh that is nearest to what was wanted.
  std::optional<glm::dvec2> slide_along(const glm::dvec2& towards_m) {
    const Xyz wanted = to_y_up({towards_m, position_m.z});
    Xyz end{};
    std::array<dtPolyRef, kMaxVisited> visited{};
    int count = 0;
    const dtStatus status =
        query->moveAlongSurface(polygon, to_y_up(position_m).data(), wanted.data(), &filter,
                                end.data(), visited.data(), &count, kMaxVisited);
    if (!dtStatusFailed(status) && count > 0) {
      settle(visited[static_cast<std::size_t>(count) - 1], end);
    }
    // What is missing stands square on the edge. Positions are floats: less is rounding.
    constexpr double kRounding_m = 1e-5;
    const glm::dvec2 missing_m = glm::dvec2(position_m) - towards_m;
    if (glm::length(missing_m) <= kRounding_m) return std::nullopt;
    return glm::normalize(missing_m);
  }

  void settle(dtPolyRef at, Xyz& p) {
    float height_m = 0.0F;
    if (dtStatusSucceed(query->getPolyHeight(at, p.data(), &height_m))) p[1] = height_m;
    polygon = at;
    position_m = to_z_up(p.data());
  }
};

NavmeshWalker::NavmeshWalker(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
NavmeshWalker::~NavmeshWalker() = default;
NavmeshWalker::NavmeshWalker(NavmeshWalker&&) noexcept = default;
NavmeshWalker& NavmeshWalker::operator=(NavmeshWalker&&) noexcept = default;

std::optional<NavmeshWalker> NavmeshWalker::place(const Navmesh& navmesh,
                                                  const glm::dvec3& p_m) {
  if (!core::within_world(p_m)) return std::nullopt;
  auto impl = std::make_unique<Impl>();
  impl->query.reset(dtAllocNavMeshQuery());
  const dtNavMesh& mesh = internal::NavmeshAccess::mesh(navmesh);
  if (dtStatusFailed(impl->query->init(&mesh, kMaxNodes))) {
    throw core::InputError("navigation mesh: query failed");
  }
  impl->filter.setIncludeFlags(0xffff);
  const Xyz extents = {2.0F, 4.0F, 2.0F};
  Xyz nearest{};
  dtPolyRef polygon = 0;
  const dtStatus status = impl->query->findNearestPoly(
      to_y_up(p_m).data(), extents.data(), &impl->filter, &polygon, nearest.data());
  if (dtStatusFailed(status) || polygon == 0) return std::nullopt;
  impl->settle(polygon, nearest);
  return NavmeshWalker(std::move(impl));
}

NavmeshWalker::Step NavmeshWalker::walk(const glm::dvec2& towards_m,
                                        ContactResponse response) {
  const glm::dvec3 from_m = impl_->position_m;
  const auto squared_m2 = [&](const glm::dvec2& p_m) {
    const glm::dvec2 d = p_m - glm::dvec2(from_m);
    return glm::dot(d, d);
  };
  Step step;
  if (squared_m2(towards_m) > 0.0) {
    step.wall_normal = response == ContactResponse::kStop ? impl_->stop_at_edge(towards_m)
                                                          : impl_->slide_along(towards_m);
  }
  step.position_m = impl_->position_m;
  step.shortened =
      squared_m2(glm::dvec2(step.position_m)) + kShorter_m2 < squared_m2(towards_m);
  return step;
}

const glm::dvec3& NavmeshWalker::position_m() const { return impl_->position_m; }

}  // namespace segsim::sim
