#include "sim/ground/navmesh.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>

#include <recastnavigation/DetourNavMesh.h>
#include <recastnavigation/DetourNavMeshBuilder.h>
#include <recastnavigation/DetourNavMeshQuery.h>
#include <recastnavigation/Recast.h>
#include <glm/geometric.hpp>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"
#include "core/input/bounds.h"
#include "sim/ground/ground_limit.h"
#include "sim/ground/internal/navmesh_access.h"
#include "sim/ground/internal/navmesh_tile.h"
#include "sim/ground/no_room.h"

namespace segsim::sim {
namespace {

using internal::to_y_up;
using internal::to_z_up;
using internal::Xyz;

template <class T, void (*Free)(T*)>
struct Deleter {
  void operator()(T* object) const { Free(object); }
};
using HeightfieldPtr =
    std::unique_ptr<rcHeightfield, Deleter<rcHeightfield, rcFreeHeightField>>;
using CompactPtr = std::unique_ptr<rcCompactHeightfield,
                                   Deleter<rcCompactHeightfield, rcFreeCompactHeightfield>>;
using ContoursPtr = std::unique_ptr<rcContourSet, Deleter<rcContourSet, rcFreeContourSet>>;
using PolyMeshPtr = std::unique_ptr<rcPolyMesh, Deleter<rcPolyMesh, rcFreePolyMesh>>;
using DetailPtr =
    std::unique_ptr<rcPolyMeshDetail, Deleter<rcPolyMeshDetail, rcFreePolyMeshDetail>>;
using NavMeshPtr = std::unique_ptr<dtNavMesh, Deleter<dtNavMesh, dtFreeNavMesh>>;
using QueryPtr = std::unique_ptr<dtNavMeshQuery, Deleter<dtNavMeshQuery, dtFreeNavMeshQuery>>;

constexpr int kMaxNodes = 8192;  ///< Polygons a search may visit.
constexpr int kMaxPath = 1024;

void require(bool done, const char* step) {
  if (!done) throw core::InputError(std::string("navigation mesh: ") + step + " failed");
}

rcConfig recast_config(const NavmeshSettings& s, const std::vector<float>& vertices) {
  rcConfig config{};
  config.cs = static_cast<float>(s.cell_m);
  config.ch = static_cast<float>(s.cell_height_m);
  config.walkableSlopeAngle = static_cast<float>(s.max_slope_deg);
  // A small term before rounding, so that 0.15 / 0.05 is 3 cells. Erosion rounds up.
  config.walkableHeight =
      static_cast<int>(std::ceil(s.agent_height_m / s.cell_height_m - 1e-6));
  config.walkableClimb = static_cast<int>(std::floor(s.max_climb_m / s.cell_height_m + 1e-6));
  config.walkableRadius = static_cast<int>(std::ceil(s.agent_radius_m / s.cell_m - 1e-6));
  config.maxEdgeLen = static_cast<int>(s.edge_max_m / s.cell_m);
  config.maxSimplificationError = static_cast<float>(s.edge_max_error_cells);
  config.minRegionArea = static_cast<int>(s.region_min_cells * s.region_min_cells);
  config.mergeRegionArea = static_cast<int>(s.region_merge_cells * s.region_merge_cells);
  config.maxVertsPerPoly = DT_VERTS_PER_POLYGON;
  config.detailSampleDist = static_cast<float>(s.detail_sample_cells * s.cell_m);
  config.detailSampleMaxError = static_cast<float>(s.detail_max_error_cells * s.cell_height_m);
  rcCalcBounds(vertices.data(), static_cast<int>(vertices.size() / 3), config.bmin,
               config.bmax);
  rcCalcGridSize(config.bmin, config.bmax, config.cs, &config.width, &config.height);
  return config;
}

CompactPtr build_heightfield(rcContext& context, const rcConfig& config,
                             const std::vector<float>& vertices,
                             const std::vector<int>& indices) {
  const int vertex_count = static_cast<int>(vertices.size() / 3);
  const int triangle_count = static_cast<int>(indices.size() / 3);
  HeightfieldPtr spans(rcAllocHeightfield());
  require(rcCreateHeightfield(&context, *spans, config.width, config.height, config.bmin,
                              config.bmax, config.cs, config.ch),
          "heightfield");
  std::vector<unsigned char> areas(static_cast<std::size_t>(triangle_count), RC_NULL_AREA);
  rcMarkWalkableTriangles(&context, config.walkableSlopeAngle, vertices.data(), vertex_count,
                          indices.data(), triangle_count, areas.data());
  require(rcRasterizeTriangles(&context, vertices.data(), vertex_count, indices.data(),
                               areas.data(), triangle_count, *spans, config.walkableClimb),
          "rasterization");
  rcFilterLowHangingWalkableObstacles(&context, config.walkableClimb, *spans);
  rcFilterLedgeSpans(&context, config.walkableHeight, config.walkableClimb, *spans);
  rcFilterWalkableLowHeightSpans(&context, config.walkableHeight, *spans);

  CompactPtr compact(rcAllocCompactHeightfield());
  require(rcBuildCompactHeightfield(&context, config.walkableHeight, config.walkableClimb,
                                    *spans, *compact),
          "compact heightfield");
  require(rcErodeWalkableArea(&context, config.walkableRadius, *compact), "erosion");
  require(rcBuildDistanceField(&context, *compact), "distance field");
  require(rcBuildRegions(&context, *compact, 0, config.minRegionArea, config.mergeRegionArea),
          "regions");
  return compact;
}

/// Detour's data block, allocated by dtAlloc; owned by the dtNavMesh that it is given to.
std::vector<unsigned char> detour_data(const rcConfig& config, const NavmeshSettings& settings,
                                       rcPolyMesh& polygons, const rcPolyMeshDetail& detail) {
  for (int i = 0; i < polygons.npolys; ++i) polygons.flags[i] = 1;
  dtNavMeshCreateParams params{};
  params.verts = polygons.verts;
  params.vertCount = polygons.nverts;
  params.polys = polygons.polys;
  params.polyAreas = polygons.areas;
  params.polyFlags = polygons.flags;
  params.polyCount = polygons.npolys;
  params.nvp = polygons.nvp;
  params.detailMeshes = detail.meshes;
  params.detailVerts = detail.verts;
  params.detailVertsCount = detail.nverts;
  params.detailTris = detail.tris;
  params.detailTriCount = detail.ntris;
  params.walkableHeight = static_cast<float>(settings.agent_height_m);
  params.walkableRadius = static_cast<float>(settings.agent_radius_m);
  params.walkableClimb = static_cast<float>(settings.max_climb_m);
  std::copy_n(polygons.bmin, 3, params.bmin);
  std::copy_n(polygons.bmax, 3, params.bmax);
  params.cs = config.cs;
  params.ch = config.ch;
  params.buildBvTree = true;
  unsigned char* data = nullptr;
  int size = 0;
  require(dtCreateNavMeshData(&params, &data, &size), "tile data");
  std::vector<unsigned char> copy(data, data + size);
  dtFree(data);
  return copy;
}

// File: magic, version, the settings as doubles, size of the block, block.
constexpr std::array<char, 8> kMagic = {'s', 'e', 'g', 's', 'i', 'm', 'n', 'm'};
constexpr std::uint32_t kVersion = 1;

/// The one list of fields, for both directions.
template <class Settings>
auto fields_of(Settings& s) {
  return std::array{&s.cell_m,
                    &s.cell_height_m,
                    &s.agent_height_m,
                    &s.agent_radius_m,
                    &s.max_climb_m,
                    &s.max_slope_deg,
                    &s.region_min_cells,
                    &s.region_merge_cells,
                    &s.edge_max_m,
                    &s.edge_max_error_cells,
                    &s.detail_sample_cells,
                    &s.detail_max_error_cells};
}

}  // namespace

struct Navmesh::Impl {
  NavmeshSettings settings;
  std::vector<unsigned char>
      data;  ///< As saved: Detour writes into the copy that it is given.
  NavMeshPtr mesh;
  QueryPtr query;
  dtQueryFilter filter;
  std::vector<int> island_of_polygon;
  std::vector<double> island_areas_m2;
  /// Fans of all polygons, for sampling by area: running sum of areas per island.
  struct Corner {
    dtPolyRef polygon;
    glm::dvec3 a, b, c;
    double area_until_m2;
  };
  std::vector<std::vector<Corner>> fans;

  Impl(const NavmeshSettings& of, std::vector<unsigned char> block)
      : settings(of), data(std::move(block)) {
    auto* owned = static_cast<unsigned char*>(dtAlloc(data.size(), DT_ALLOC_PERM));
    require(owned != nullptr, "allocation");
    std::memcpy(owned, data.data(), data.size());
    mesh.reset(dtAllocNavMesh());
    if (dtStatusFailed(mesh->init(owned, static_cast<int>(data.size()), DT_TILE_FREE_DATA))) {
      dtFree(owned);
      require(false, "tile");
    }
    query.reset(dtAllocNavMeshQuery());
    require(dtStatusSucceed(query->init(mesh.get(), kMaxNodes)), "query");
    filter.setIncludeFlags(0xffff);
    find_islands();
  }

  [[nodiscard]] const dtMeshTile& tile() const {
    return *static_cast<const dtNavMesh&>(*mesh).getTile(0);
  }
  [[nodiscard]] int polygon_index(dtPolyRef ref) const {
    return static_cast<int>(ref - mesh->getPolyRefBase(&tile()));
  }
  [[nodiscard]] glm::dvec3 vertex(const dtPoly& polygon, int k) const {
    return to_z_up(&tile().verts[polygon.verts[k] * 3]);
  }

  void find_islands();
  void fan_polygon(int index, std::vector<Corner>& fan) const;
};

void Navmesh::Impl::fan_polygon(int index, std::vector<Corner>& fan) const {
  const dtPoly& polygon = tile().polys[index];
  for (int k = 2; k < polygon.vertCount; ++k) {
    Corner corner{mesh->getPolyRefBase(&tile()) + static_cast<dtPolyRef>(index),
                  vertex(polygon, 0), vertex(polygon, k - 1), vertex(polygon, k), 0.0};
    const double area_m2 =
        0.5 * std::abs(glm::cross(corner.b - corner.a, corner.c - corner.a).z);
    corner.area_until_m2 = (fan.empty() ? 0.0 : fan.back().area_until_m2) + area_m2;
    fan.push_back(corner);
  }
}

void Navmesh::Impl::find_islands() {
  const dtMeshTile& t = tile();
  const int count = t.header->polyCount;
  std::vector<int> raw(static_cast<std::size_t>(count), -1);
  std::vector<std::vector<Corner>> raw_fans;
  for (int first = 0; first < count; ++first) {
    if (raw[static_cast<std::size_t>(first)] >= 0) continue;
    const int id = static_cast<int>(raw_fans.size());
    raw_fans.emplace_back();
    std::vector<int> stack = {first};
    raw[static_cast<std::size_t>(first)] = id;
    while (!stack.empty()) {
      const int polygon = stack.back();
      stack.pop_back();
      fan_polygon(polygon, raw_fans.back());
      for (unsigned link = t.polys[polygon].firstLink; link != DT_NULL_LINK;
           link = t.links[link].next) {
        const int other = polygon_index(t.links[link].ref);
        if (other < 0 || other >= count || raw[static_cast<std::size_t>(other)] >= 0) continue;
        raw[static_cast<std::size_t>(other)] = id;
        stack.push_back(other);
      }
    }
  }
  const auto area = [&](std::size_t id) {
    return raw_fans[id].empty() ? 0.0 : raw_fans[id].back().area_until_m2;
  };
  std::vector<std::size_t> order(raw_fans.size());
  for (std::size_t k = 0; k < order.size(); ++k) order[k] = k;
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return area(a) > area(b); });
  std::vector<int> rank(order.size());
  for (std::size_t k = 0; k < order.size(); ++k) {
    rank[order[k]] = static_cast<int>(k);
    island_areas_m2.push_back(area(order[k]));
    fans.push_back(std::move(raw_fans[order[k]]));
  }
  island_of_polygon.reserve(raw.size());
  for (const int id : raw) island_of_polygon.push_back(rank[static_cast<std::size_t>(id)]);
}

Navmesh::Navmesh(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Navmesh::~Navmesh() = default;
Navmesh::Navmesh(Navmesh&&) noexcept = default;
Navmesh& Navmesh::operator=(Navmesh&&) noexcept = default;

Navmesh Navmesh::build(const TriangleMesh& mesh, const NavmeshSettings& settings) {
  SEGSIM_CHECK(settings.cell_m > 0.0 && settings.cell_height_m > 0.0, "cell size");
  if (mesh.triangles.empty()) {
    throw core::InputError::expected("navigation mesh", "triangles", "none");
  }
  // (x, y, z) -> (x, z, -y) keeps orientation, so triangles keep their winding.
  std::vector<float> vertices;
  for (const glm::vec3& p : mesh.positions_m) {
    const Xyz q = to_y_up(glm::dvec3(p));
    vertices.insert(vertices.end(), q.begin(), q.end());
  }
  std::vector<int> indices;
  for (const glm::uvec3& t : mesh.triangles) {
    for (int corner = 0; corner < 3; ++corner) indices.push_back(static_cast<int>(t[corner]));
  }
  const rcConfig config = recast_config(settings, vertices);
  const auto cells = [&](int axis) {
    return (static_cast<double>(config.bmax[axis]) - static_cast<double>(config.bmin[axis])) /
           settings.cell_m;
  };
  require_ground_cells(cells(0), cells(2), "navigation mesh");
  rcContext context(false);
  const CompactPtr compact = build_heightfield(context, config, vertices, indices);
  const ContoursPtr contours(rcAllocContourSet());
  require(rcBuildContours(&context, *compact, config.maxSimplificationError, config.maxEdgeLen,
                          *contours),
          "contours");
  const PolyMeshPtr polygons(rcAllocPolyMesh());
  require(rcBuildPolyMesh(&context, *contours, config.maxVertsPerPoly, *polygons), "polygons");
  if (polygons->npolys == 0) {
    throw NoRoom(core::InputError::expected("navigation mesh", "room for the robot",
                                            "no walkable area"));
  }
  const DetailPtr detail(rcAllocPolyMeshDetail());
  require(rcBuildPolyMeshDetail(&context, *polygons, *compact, config.detailSampleDist,
                                config.detailSampleMaxError, *detail),
          "detail");
  return Navmesh(
      std::make_unique<Impl>(settings, detour_data(config, settings, *polygons, *detail)));
}

void Navmesh::save(const std::filesystem::path& file) const {
  core::write_file_atomically(file, [&](std::ostream& out) {
    out.write(kMagic.data(), kMagic.size());
    const auto put = [&out](const auto& value) {
      const auto bytes = std::bit_cast<std::array<char, sizeof(value)>>(value);
      out.write(bytes.data(), bytes.size());
    };
    put(kVersion);
    for (const double* value : fields_of(std::as_const(impl_->settings))) put(*value);
    put(static_cast<std::uint64_t>(impl_->data.size()));
    for (const unsigned char byte : impl_->data) out.put(static_cast<char>(byte));
  });
}

Navmesh Navmesh::load(const std::filesystem::path& file) {
  const std::string place = file.string();
  const std::string text = core::read_file(file);
  std::size_t at = kMagic.size();
  if (text.size() < at || !std::equal(kMagic.begin(), kMagic.end(), text.begin())) {
    throw core::InputError::expected(place, "a navigation mesh", "another file");
  }
  const auto get = [&](auto& value) {
    if (text.size() - at < sizeof(value)) {
      throw core::InputError::expected(place, "more data", "the end of the file");
    }
    std::memcpy(&value, text.data() + at, sizeof(value));
    at += sizeof(value);
  };
  std::uint32_t version = 0;
  get(version);
  if (version != kVersion) {
    throw core::InputError::expected(place, "version " + std::to_string(kVersion),
                                     std::to_string(version));
  }
  NavmeshSettings settings;
  for (double* value : fields_of(settings)) get(*value);
  std::uint64_t size = 0;
  get(size);
  if (text.size() - at != size || size < sizeof(dtMeshHeader)) {
    throw core::InputError::expected(place, std::to_string(size) + " bytes of mesh",
                                     std::to_string(text.size() - at));
  }
  std::vector<unsigned char> block(text.begin() + static_cast<std::ptrdiff_t>(at), text.end());
  internal::check_navmesh_tile(block, place);
  return Navmesh(std::make_unique<Impl>(settings, std::move(block)));
}

const dtNavMesh& internal::NavmeshAccess::mesh(const Navmesh& navmesh) {
  return *navmesh.impl_->mesh;
}

const NavmeshSettings& Navmesh::settings() const { return impl_->settings; }

int Navmesh::polygon_count() const { return impl_->tile().header->polyCount; }

const std::vector<double>& Navmesh::island_areas_m2() const { return impl_->island_areas_m2; }

std::optional<NavPoint> Navmesh::nearest(const glm::dvec3& p_m, double reach_m) const {
  // Detour compares squared distances, and takes the winner without asking whether it has one.
  if (!core::within_world(p_m)) return std::nullopt;
  const Xyz center = to_y_up(p_m);
  const Xyz extents = {static_cast<float>(reach_m), 1.0F, static_cast<float>(reach_m)};
  dtPolyRef ref = 0;
  Xyz found{};
  if (dtStatusFailed(impl_->query->findNearestPoly(center.data(), extents.data(),
                                                   &impl_->filter, &ref, found.data())) ||
      ref == 0) {
    return std::nullopt;
  }
  const glm::dvec3 position_m = to_z_up(found.data());
  // Detour searches a box; within reach means a disc here.
  if (std::hypot(position_m.x - p_m.x, position_m.y - p_m.y) > reach_m) return std::nullopt;
  const auto polygon = static_cast<std::size_t>(impl_->polygon_index(ref));
  return NavPoint{position_m, impl_->island_of_polygon[polygon]};
}

glm::dvec3 Navmesh::random_point(core::RandomStream& random, int island) const {
  SEGSIM_CHECK(island >= 0 && island < static_cast<int>(impl_->fans.size()), "island");
  const auto& fan = impl_->fans[static_cast<std::size_t>(island)];
  const double target_m2 = random.uniform() * fan.back().area_until_m2;
  const auto corner = std::upper_bound(
      fan.begin(), fan.end() - 1, target_m2,
      [](double value, const Impl::Corner& c) { return value < c.area_until_m2; });
  // Uniform in a triangle: the square root spreads points evenly away from corner a.
  const double r = std::sqrt(random.uniform());
  const double s = random.uniform();
  const glm::dvec3 p =
      corner->a * (1.0 - r) + corner->b * (r * (1.0 - s)) + corner->c * (r * s);
  float height = 0.0F;
  const bool known = dtStatusSucceed(
      impl_->query->getPolyHeight(corner->polygon, to_y_up(p).data(), &height));
  return {p.x, p.y, known ? static_cast<double>(height) : p.z};
}

std::optional<NavPath> Navmesh::find_path(const glm::dvec3& from_m,
                                          const glm::dvec3& to_m) const {
  if (!core::within_world(from_m) || !core::within_world(to_m)) return std::nullopt;
  const Xyz extents = {0.5F, 1.0F, 0.5F};
  const Xyz from = to_y_up(from_m);
  const Xyz to = to_y_up(to_m);
  dtPolyRef first = 0;
  dtPolyRef last = 0;
  Xyz snapped{};
  const dtNavMeshQuery& query = *impl_->query;
  static_cast<void>(query.findNearestPoly(from.data(), extents.data(), &impl_->filter, &first,
                                          snapped.data()));
  static_cast<void>(
      query.findNearestPoly(to.data(), extents.data(), &impl_->filter, &last, snapped.data()));
  if (first == 0 || last == 0) return std::nullopt;
  std::array<dtPolyRef, kMaxPath> corridor{};
  int corridor_count = 0;
  const dtStatus status = query.findPath(first, last, from.data(), to.data(), &impl_->filter,
                                         corridor.data(), &corridor_count, kMaxPath);
  // A partial path or one that did not fit counts as none.
  if (!dtStatusSucceed(status) || (status & DT_STATUS_DETAIL_MASK) != 0 ||
      corridor_count == 0 || corridor[static_cast<std::size_t>(corridor_count) - 1] != last) {
    return std::nullopt;
  }
  std::vector<float> corners(3 * kMaxPath);
  int corner_count = 0;
  if (!dtStatusSucceed(query.findStraightPath(from.data(), to.data(), corridor.data(),
                                              corridor_count, corners.data(), nullptr, nullptr,
                                              &corner_count, kMaxPath))) {
    return std::nullopt;
  }
  NavPath path;
  for (int k = 0; k < corner_count; ++k) {
    path.corners_m.push_back(to_z_up(&corners[static_cast<std::size_t>(3 * k)]));
    if (k > 0) {
      path.length_m += glm::distance(path.corners_m[static_cast<std::size_t>(k) - 1],
                                     path.corners_m.back());
    }
  }
  return path;
}

}  // namespace segsim::sim
