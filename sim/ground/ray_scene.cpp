#include "sim/ground/ray_scene.h"

#include <algorithm>
#include <cstring>
#include <deque>
#include <limits>
#include <new>
#include <string>
#include <tuple>

#include <embree3/rtcore.h>
#include <oneapi/tbb/task_arena.h>
#include <glm/geometric.hpp>

#include "core/check.h"
#include "core/error.h"
#include "core/formatted.h"
#include "core/input/bounds.h"
#include "core/process/kernel_choice.h"

namespace segsim::sim {
namespace {

/// Embree divides by an estimate of the reciprocal whose last bits differ between the makers
/// of processors. So it only says which triangles a ray may meet; where it meets them, and
/// which is the first, is computed here in double precision. Triangles this much farther than
/// the first one so far are asked for, too: they may be nearer after all, or as near.
constexpr float kTieRange = 1.0F + 1e-5F;

/// The buffers of a geometry, for filters.
struct MeshBuffers {
  const glm::vec3* positions_m = nullptr;
  const glm::uvec3* triangles = nullptr;
};

/// A ray and the plane of a triangle (Moeller and Trumbore 1997). t is no number if the ray
/// lies in the plane.
struct Meeting {
  double t = std::numeric_limits<double>::quiet_NaN(), u = 0.0, v = 0.0;
  glm::dvec3 normal{0.0};  ///< Not unit; zero for a triangle without area.
};

Meeting meet(const MeshBuffers& mesh, unsigned int triangle, const glm::dvec3& origin_m,
             const glm::dvec3& direction) {
  const glm::uvec3 corners = mesh.triangles[triangle];
  const glm::dvec3 first(mesh.positions_m[corners.x]);
  const glm::dvec3 edge_u = glm::dvec3(mesh.positions_m[corners.y]) - first;
  const glm::dvec3 edge_v = glm::dvec3(mesh.positions_m[corners.z]) - first;
  Meeting meeting;
  meeting.normal = glm::cross(edge_u, edge_v);
  const glm::dvec3 p = glm::cross(direction, edge_v);
  const double determinant = glm::dot(edge_u, p);
  if (determinant == 0.0) return meeting;
  const glm::dvec3 from_first = origin_m - first;
  const glm::dvec3 q = glm::cross(from_first, edge_u);
  meeting.t = glm::dot(edge_v, q) / determinant;
  meeting.u = std::clamp(glm::dot(from_first, p) / determinant, 0.0, 1.0);
  meeting.v = std::clamp(glm::dot(direction, q) / determinant, 0.0, 1.0);
  return meeting;
}

/// One ray of a query, with the first meeting so far.
struct Query {
  glm::dvec3 origin_m{0.0}, direction{0.0};
  double t_near = 0.0, t_far = std::numeric_limits<double>::infinity();
  Meeting first{};
  std::uint32_t mesh = RayHit::kNone, triangle = 0;
};

/// What filters are told: the rays by their `id`.
struct QueryContext : RTCIntersectContext {
  explicit QueryContext(Query* rays) : RTCIntersectContext{}, queries(rays) {
    rtcInitIntersectContext(this);
  }
  Query* queries;
};

template <class Accept>
void for_each_candidate(const RTCFilterFunctionNArguments* args, const Accept& accept) {
  const auto& mesh = *static_cast<const MeshBuffers*>(args->geometryUserPtr);
  Query* queries = static_cast<QueryContext*>(args->context)->queries;
  for (unsigned int i = 0; i < args->N; ++i) {
    if (args->valid[i] == 0) continue;
    Query& query = queries[RTCRayN_id(args->ray, args->N, i)];
    const unsigned int triangle = RTCHitN_primID(args->hit, args->N, i);
    const Meeting meeting = meet(mesh, triangle, query.origin_m, query.direction);
    const bool in_range = meeting.t >= query.t_near && meeting.t <= query.t_far;
    if (!in_range || !accept(i, query, meeting, triangle)) args->valid[i] = 0;
  }
}

/// Keeps the first meeting; of several at one distance that of the smallest mesh and triangle,
/// so that it does not matter in which order they come.
void keep_first(const RTCFilterFunctionNArguments* args) {
  for_each_candidate(
      args, [&](unsigned int i, Query& query, const Meeting& meeting, unsigned int triangle) {
        const unsigned int mesh = RTCHitN_geomID(args->hit, args->N, i);
        const bool earlier = query.mesh == RayHit::kNone ||
                             std::tie(meeting.t, mesh, triangle) <
                                 std::tie(query.first.t, query.mesh, query.triangle);
        if (!earlier) return false;
        query.first = meeting;
        query.mesh = mesh;
        query.triangle = triangle;
        RTCRayN_tfar(args->ray, args->N, i) = static_cast<float>(meeting.t) * kTieRange;
        return true;
      });
}

void keep_any(const RTCFilterFunctionNArguments* args) {
  for_each_candidate(args,
                     [](unsigned int, Query&, const Meeting&, unsigned int) { return true; });
}

Query make_query(const glm::vec3& origin_m, const glm::vec3& direction, float t_near,
                 float t_far) {
  Query query;
  query.origin_m = origin_m;
  query.direction = direction;
  query.t_near = t_near;
  query.t_far = t_far;
  return query;
}

RayHit hit_of(const Query& query) {
  RayHit hit;
  if (query.mesh == RayHit::kNone) return hit;
  hit.t = static_cast<float>(query.first.t);
  hit.mesh = query.mesh;
  hit.triangle = query.triangle;
  hit.u = static_cast<float>(query.first.u);
  hit.v = static_cast<float>(query.first.v);
  const double length = glm::length(query.first.normal);
  if (length > 0.0) hit.normal = query.first.normal / length;
  return hit;
}

/// Embree ends the process on numbers that single precision cannot square, wherever they come
/// from. Readers refuse them with file and line; this is the last door.
void require_ray(const glm::vec3& origin_m, const glm::vec3& direction) {
  constexpr float kLongest2 = 1e30F;
  if (core::within_world(glm::dvec3(origin_m)) &&
      glm::dot(direction, direction) <= kLongest2) {
    return;
  }
  throw core::InputError::expected(
      "a ray", core::print("an origin within %g m and a finite direction", core::kFarthest_m),
      core::print("(%g, %g, %g) and (%g, %g, %g)", static_cast<double>(origin_m.x),
                  static_cast<double>(origin_m.y), static_cast<double>(origin_m.z),
                  static_cast<double>(direction.x), static_cast<double>(direction.y),
                  static_cast<double>(direction.z)));
}

RTCRay make_ray(const glm::vec3& origin_m, const glm::vec3& direction, float t_near,
                float t_far) {
  RTCRay ray{};
  ray.org_x = origin_m.x;
  ray.org_y = origin_m.y;
  ray.org_z = origin_m.z;
  ray.tnear = t_near / kTieRange;
  ray.dir_x = direction.x;
  ray.dir_y = direction.y;
  ray.dir_z = direction.z;
  ray.tfar = t_far * kTieRange;
  ray.mask = 0xFFFFFFFF;
  return ray;
}

/// @param buffers  Filled in; Embree keeps its address.
void attach_mesh(RTCDevice device, RTCScene scene, const SubMesh& mesh, MeshBuffers& buffers) {
  for (const glm::uvec3& triangle : mesh.triangles) {
    const unsigned int largest = std::max({triangle.x, triangle.y, triangle.z});
    SEGSIM_CHECK(largest < mesh.positions_m.size(), "vertex " + std::to_string(largest));
  }
  for (const glm::vec3& p_m : mesh.positions_m) {
    if (core::within_world(glm::dvec3(p_m))) continue;
    throw core::InputError::expected(
        "mesh", core::print("vertices within %g m of the origin", core::kFarthest_m),
        core::print("(%g, %g, %g)", static_cast<double>(p_m.x), static_cast<double>(p_m.y),
                    static_cast<double>(p_m.z)));
  }
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  if (!mesh.triangles.empty()) {
    void* vertices =
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                sizeof(glm::vec3), mesh.positions_m.size());
    void* indices =
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                sizeof(glm::uvec3), mesh.triangles.size());
    if (vertices == nullptr || indices == nullptr) throw std::bad_alloc();
    std::memcpy(vertices, mesh.positions_m.data(),
                mesh.positions_m.size() * sizeof(glm::vec3));
    std::memcpy(indices, mesh.triangles.data(), mesh.triangles.size() * sizeof(glm::uvec3));
    buffers = {static_cast<const glm::vec3*>(vertices),
               static_cast<const glm::uvec3*>(indices)};
  }
  rtcSetGeometryUserData(geometry, &buffers);
  rtcSetGeometryIntersectFilterFunction(geometry, keep_first);
  rtcSetGeometryOccludedFilterFunction(geometry, keep_any);
  rtcCommitGeometry(geometry);
  // Empty meshes are attached too: geometry ids must equal mesh indices.
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
}

}  // namespace

struct RayScene::Embree {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  std::deque<MeshBuffers> buffers;  ///< Of each mesh; their addresses stay.

  // Embree's own "threads" setting would limit TBB in the whole process.
  Embree() : device(rtcNewDevice(device_settings())) {
    SEGSIM_CHECK(device != nullptr, "Embree device");
    scene = rtcNewScene(device);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
    // Watertight: no ray slips through the edge between two triangles.
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
  }
  /// Which triangles are met at their very edges depends on the instructions, too.
  static const char* device_settings() {
    const bool reproducible = core::kernel_choice() == core::KernelChoice::kReproducible;
    return reproducible ? "max_isa=avx2" : nullptr;
  }
  ~Embree() {
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
  }
  Embree(const Embree&) = delete;
  Embree& operator=(const Embree&) = delete;
};

RayScene::RayScene(const MeshScene& scene, int threads) : embree_(std::make_unique<Embree>()) {
  SEGSIM_CHECK(threads >= 0, std::to_string(threads));
  for (const SubMesh& mesh : scene.meshes) {
    attach_mesh(embree_->device, embree_->scene, mesh, embree_->buffers.emplace_back());
  }
  tbb::task_arena arena(threads == 0 ? tbb::task_arena::automatic : threads);
  arena.execute([&] { rtcJoinCommitScene(embree_->scene); });
  const RTCError error = rtcGetDeviceError(embree_->device);
  if (error == RTC_ERROR_OUT_OF_MEMORY) throw std::bad_alloc();
  SEGSIM_CHECK(error == RTC_ERROR_NONE, "Embree could not build");
}

RayScene::~RayScene() = default;

RayHit RayScene::cast(const glm::vec3& origin_m, const glm::vec3& direction, float t_near,
                      float t_far) const {
  require_ray(origin_m, direction);
  Query asked = make_query(origin_m, direction, t_near, t_far);
  QueryContext context(&asked);
  RTCRayHit query{};
  query.ray = make_ray(origin_m, direction, t_near, t_far);
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(embree_->scene, &context, &query);
  return hit_of(asked);
}

std::array<RayHit, 8> RayScene::cast8(const glm::vec3& origin_m,
                                      const std::array<glm::vec3, 8>& directions) const {
  std::array<Query, 8> asked;
  QueryContext context(asked.data());
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  alignas(32) RTCRayHit8 query{};
  alignas(32) std::array<int, 8> valid{};
  for (std::size_t i = 0; i < 8; ++i) {
    require_ray(origin_m, directions[i]);
    asked[i] = make_query(origin_m, directions[i], 0.0F, kFar);
    valid[i] = -1;
    query.ray.org_x[i] = origin_m.x;
    query.ray.org_y[i] = origin_m.y;
    query.ray.org_z[i] = origin_m.z;
    query.ray.dir_x[i] = directions[i].x;
    query.ray.dir_y[i] = directions[i].y;
    query.ray.dir_z[i] = directions[i].z;
    query.ray.tfar[i] = kFar;
    query.ray.mask[i] = 0xFFFFFFFF;
    query.ray.id[i] = static_cast<unsigned int>(i);
    query.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
  rtcIntersect8(valid.data(), embree_->scene, &context, &query);
  std::array<RayHit, 8> hits;
  for (std::size_t i = 0; i < 8; ++i) hits[i] = hit_of(asked[i]);
  return hits;
}

bool RayScene::occluded(const glm::vec3& origin_m, const glm::vec3& direction, float t_near,
                        float t_far) const {
  require_ray(origin_m, direction);
  Query asked = make_query(origin_m, direction, t_near, t_far);
  QueryContext context(&asked);
  RTCRay ray = make_ray(origin_m, direction, t_near, t_far);
  rtcOccluded1(embree_->scene, &context, &ray);
  return ray.tfar < 0.0F;
}

}  // namespace segsim::sim
