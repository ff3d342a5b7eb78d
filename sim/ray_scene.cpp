#include "sim/ray_scene.h"

#include <algorithm>
#include <cstring>
#include <string>

#include <embree3/rtcore.h>
#include <oneapi/tbb/task_arena.h>
#include <glm/geometric.hpp>

#include "core/check.h"

namespace segsim::sim {
namespace {

glm::vec3 unit_or_zero(const glm::vec3& v) {
  const float length = glm::length(v);
  return length > 0.0F ? v / length : glm::vec3(0.0F);
}

RTCRay make_ray(const glm::vec3& origin_m, const glm::vec3& direction, float t_near,
                float t_far) {
  RTCRay ray{};
  ray.org_x = origin_m.x;
  ray.org_y = origin_m.y;
  ray.org_z = origin_m.z;
  ray.tnear = t_near;
  ray.dir_x = direction.x;
  ray.dir_y = direction.y;
  ray.dir_z = direction.z;
  ray.tfar = t_far;
  ray.mask = 0xFFFFFFFF;
  return ray;
}

void attach_mesh(RTCDevice device, RTCScene scene, const SubMesh& mesh) {
  for (const glm::uvec3& triangle : mesh.triangles) {
    const unsigned int largest = std::max({triangle.x, triangle.y, triangle.z});
    SEGSIM_CHECK(largest < mesh.positions_m.size(), "vertex " + std::to_string(largest));
  }
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  if (!mesh.triangles.empty()) {
    void* vertices =
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                sizeof(glm::vec3), mesh.positions_m.size());
    void* indices =
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                sizeof(glm::uvec3), mesh.triangles.size());
    SEGSIM_CHECK(vertices != nullptr && indices != nullptr, "Embree is out of memory");
    std::memcpy(vertices, mesh.positions_m.data(),
                mesh.positions_m.size() * sizeof(glm::vec3));
    std::memcpy(indices, mesh.triangles.data(), mesh.triangles.size() * sizeof(glm::uvec3));
  }
  rtcCommitGeometry(geometry);
  // Empty meshes are attached too: geometry ids must equal mesh indices.
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
}

}  // namespace

struct RayScene::Embree {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;

  // Embree's own "threads" setting would limit TBB in the whole process.
  Embree() : device(rtcNewDevice(nullptr)) {
    SEGSIM_CHECK(device != nullptr, "Embree device");
    scene = rtcNewScene(device);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_HIGH);
    // Watertight: no ray slips through the edge between two triangles.
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
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
  for (const SubMesh& mesh : scene.meshes) attach_mesh(embree_->device, embree_->scene, mesh);
  tbb::task_arena arena(threads == 0 ? tbb::task_arena::automatic : threads);
  arena.execute([&] { rtcJoinCommitScene(embree_->scene); });
  SEGSIM_CHECK(rtcGetDeviceError(embree_->device) == RTC_ERROR_NONE, "Embree could not build");
}

RayScene::~RayScene() = default;

RayHit RayScene::cast(const glm::vec3& origin_m, const glm::vec3& direction, float t_near,
                      float t_far) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit query{};
  query.ray = make_ray(origin_m, direction, t_near, t_far);
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(embree_->scene, &context, &query);
  RayHit hit;
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return hit;
  hit.t = query.ray.tfar;
  hit.mesh = query.hit.geomID;
  hit.triangle = query.hit.primID;
  hit.u = query.hit.u;
  hit.v = query.hit.v;
  hit.normal = unit_or_zero({query.hit.Ng_x, query.hit.Ng_y, query.hit.Ng_z});
  return hit;
}

std::array<RayHit, 8> RayScene::cast8(const glm::vec3& origin_m,
                                      const std::array<glm::vec3, 8>& directions) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  alignas(32) RTCRayHit8 query{};
  alignas(32) std::array<int, 8> valid{};
  for (std::size_t i = 0; i < 8; ++i) {
    valid[i] = -1;
    query.ray.org_x[i] = origin_m.x;
    query.ray.org_y[i] = origin_m.y;
    query.ray.org_z[i] = origin_m.z;
    query.ray.dir_x[i] = directions[i].x;
    query.ray.dir_y[i] = directions[i].y;
    query.ray.dir_z[i] = directions[i].z;
    query.ray.tfar[i] = kFar;
    query.ray.mask[i] = 0xFFFFFFFF;
    query.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
  rtcIntersect8(valid.data(), embree_->scene, &context, &query);
  std::array<RayHit, 8> hits;
  for (std::size_t i = 0; i < 8; ++i) {
    if (query.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID) continue;
    RayHit& hit = hits[i];
    hit.t = query.ray.tfar[i];
    hit.mesh = query.hit.geomID[i];
    hit.triangle = query.hit.primID[i];
    hit.u = query.hit.u[i];
    hit.v = query.hit.v[i];
    hit.normal = unit_or_zero({query.hit.Ng_x[i], query.hit.Ng_y[i], query.hit.Ng_z[i]});
  }
  return hits;
}

bool RayScene::occluded(const glm::vec3& origin_m, const glm::vec3& direction, float t_near,
                        float t_far) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRay ray = make_ray(origin_m, direction, t_near, t_far);
  rtcOccluded1(embree_->scene, &context, &ray);
  return ray.tfar < 0.0F;
}

}  // namespace segsim::sim
