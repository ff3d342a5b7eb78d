#include "renderer/scene/depth_normal.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <optional>

#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>

#include "core/check.h"
#include "core/random.h"

namespace segsim::renderer {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

/// Principal point off the centre, pixels not square.
const core::CameraIntrinsics kCamera{97, 71, 80.0, 90.0, 47.2, 37.1};

/// Depth image of a surface given by its depth along a ray (x, y, 1) of the camera.
template <class Surface>
core::Image<float> depth_of(const Surface& surface) {
  core::Image<float> depth_m(kCamera.width_px, kCamera.height_px);
  for (int y = 0; y < kCamera.height_px; ++y) {
    for (int x = 0; x < kCamera.width_px; ++x) {
      depth_m(x, y) =
          static_cast<float>(surface(kCamera.back_project({x + 0.5, y + 0.5}, 1.0)));
    }
  }
  return depth_m;
}

auto plane(const glm::dvec3& normal, double offset_m) {
  return [=](const glm::dvec3& ray) {
    const double depth_m = offset_m / glm::dot(normal, ray);
    return depth_m > 0.05 && depth_m < 100.0 ? depth_m : static_cast<double>(kNaN);
  };
}

core::CameraPose random_pose(core::RandomStream& random) {
  return core::look_at({random.normal(), random.normal(), random.normal()},
                       {4.0 + random.normal(), 3.0 * random.normal(), random.normal()});
}

glm::dvec3 in_world(const core::CameraPose& pose, const glm::dvec3& direction) {
  return glm::normalize(glm::mat3_cast(pose.rotation()) * direction);
}

TEST(DepthNormal, ExactOnPlanesAtAnySlant) {
  core::RandomStream random(3, "planes");
  int pixels = 0, unknown = 0;
  for (int i = 0; i < 40; ++i) {
    glm::dvec3 normal =
        glm::normalize(glm::dvec3(random.normal(), random.normal(), random.normal()));
    if (normal.z < 0.0) normal = -normal;
    const core::Image<float> depth_m = depth_of(plane(normal, 1.5));
    const core::CameraPose pose = random_pose(random);
    const core::Image<glm::vec3> normals = depth_normals(depth_m, kCamera, pose);
    const glm::dvec3 expected = in_world(pose, -normal);
    for (int y = 0; y < kCamera.height_px; ++y) {
      for (int x = 0; x < kCamera.width_px; ++x) {
        if (std::isnan(depth_m(x, y)) || depth_m(x, y) > 10.0F) continue;
        ++pixels;
        const glm::dvec3 found(normals(x, y));
        if (found == glm::dvec3(0.0)) {
          ++unknown;
          continue;
        }
        EXPECT_GT(glm::dot(found, expected), 1.0 - 2e-4) << i << ' ' << x << ' ' << y;
        EXPECT_NEAR(glm::length(found), 1.0, 1e-5);
      }
    }
  }
  EXPECT_GT(pixels, 100000);
  EXPECT_LT(unknown, pixels / 500);  // At the ends of the image, on the most slanted planes.
}

TEST(DepthNormal, CloseOnASphere) {
  const glm::dvec3 centre_m(0.1, -0.2, 3.0);
  constexpr double kRadiusM = 1.0;
  const auto sphere = [&](const glm::dvec3& ray) {
    const double a = glm::dot(ray, ray), b = glm::dot(ray, centre_m);
    const double d = b * b - a * (glm::dot(centre_m, centre_m) - kRadiusM * kRadiusM);
    return d < 0.0 ? static_cast<double>(kNaN) : (b - std::sqrt(d)) / a;
  };
  const core::Image<float> depth_m = depth_of(sphere);
  core::RandomStream random(4, "sphere");
  const core::CameraPose pose = random_pose(random);
  const core::Image<glm::vec3> normals = depth_normals(depth_m, kCamera, pose);
  int tested = 0;
  for (int y = 0; y < kCamera.height_px; ++y) {
    for (int x = 0; x < kCamera.width_px; ++x) {
      if (std::isnan(depth_m(x, y))) {
        EXPECT_EQ(normals(x, y), glm::vec3(0.0F));
        continue;
      }
      const glm::dvec3 p =
          kCamera.back_project({x + 0.5, y + 0.5}, static_cast<double>(depth_m(x, y)));
      const glm::dvec3 outward = (p - centre_m) / kRadiusM;
      // Towards the silhouette a pixel spans a large part of the sphere.
      if (glm::dot(outward, glm::normalize(p)) > -0.5) continue;
      ++tested;
      EXPECT_GT(glm::dot(glm::dvec3(normals(x, y)), in_world(pose, outward)), std::cos(0.02));
    }
  }
  EXPECT_GT(tested, 800);
}

TEST(DepthNormal, DoesNotReachAcrossAStep) {
  // A wall at 2 m before one at 4 m, the edge between columns 39 and 40.
  core::Image<float> depth_m(kCamera.width_px, kCamera.height_px, 4.0F);
  for (int y = 0; y < kCamera.height_px; ++y) {
    for (int x = 0; x < 40; ++x) depth_m(x, y) = 2.0F;
  }
  const core::Image<glm::vec3> normals = depth_normals(depth_m, kCamera, core::CameraPose());
  for (int y = 0; y < kCamera.height_px; ++y) {
    for (int x = 0; x < kCamera.width_px; ++x) {
      EXPECT_NEAR(glm::length(normals(x, y) - glm::vec3(0.0F, 0.0F, -1.0F)), 0.0F, 1e-5F)
          << x << ' ' << y;
    }
  }
}

TEST(DepthNormal, ACreaseBelongsToOneOfItsPlanes) {
  // Two walls that meet at a right angle in the middle of the picture.
  const glm::dvec3 left = glm::normalize(glm::dvec3(-1.0, 0.0, 1.0));
  const glm::dvec3 right = glm::normalize(glm::dvec3(1.0, 0.0, 1.0));
  const core::Image<float> depth_m = depth_of([&](const glm::dvec3& ray) {
    return std::min(plane(left, 2.0)(ray), plane(right, 2.0)(ray));
  });
  const core::Image<glm::vec3> normals =
      depth_normals(depth_m, kCamera, core::CameraPose(), {.max_bend = 1e-3F});
  for (const glm::vec3& n : normals.pixels()) {
    const double agreement =
        std::max(glm::dot(glm::dvec3(n), -left), glm::dot(glm::dvec3(n), -right));
    EXPECT_GT(agreement, 1.0 - 1e-4);
  }
}

TEST(DepthNormal, UnknownNeighboursAreLeftOut) {
  core::Image<float> depth_m(7, 5, 2.0F);
  depth_m(3, 2) = kNaN;
  depth_m(0, 0) = -1.0F;
  depth_m(6, 0) = std::numeric_limits<float>::infinity();
  const core::CameraIntrinsics camera{7, 5, 10.0, 10.0, 3.5, 2.5};
  const core::Image<glm::vec3> normals = depth_normals(depth_m, camera, core::CameraPose());
  for (int y = 0; y < 5; ++y) {
    for (int x = 0; x < 7; ++x) {
      const bool known = depth_m(x, y) == 2.0F;
      EXPECT_EQ(normals(x, y), glm::vec3(0.0F, 0.0F, known ? -1.0F : 0.0F)) << x << ' ' << y;
    }
  }
  // A pixel whose neighbours on both sides are far off belongs to no surface.
  core::Image<float> needle(5, 5, 5.0F);
  needle(2, 2) = 1.0F;
  const core::CameraIntrinsics small{5, 5, 10.0, 10.0, 2.5, 2.5};
  EXPECT_EQ(depth_normals(needle, small, core::CameraPose())(2, 2), glm::vec3(0.0F));
}

TEST(DepthNormal, OnePixelAndEmptyImages) {
  const core::CameraIntrinsics one{1, 1, 1.0, 1.0, 0.5, 0.5};
  EXPECT_EQ(depth_normals(core::Image<float>(1, 1, 2.0F), one, core::CameraPose())(0, 0),
            glm::vec3(0.0F));
  EXPECT_TRUE(depth_normals(core::Image<float>(), one, core::CameraPose()).empty());
}

TEST(DepthNormal, RowsAreIndependent) {
  const core::Image<float> depth_m = depth_of(plane({0.3, -0.2, 0.9}, 2.0));
  const core::Image<glm::vec3> whole = depth_normals(depth_m, kCamera, core::CameraPose());
  core::Image<glm::vec3> parts(kCamera.width_px, kCamera.height_px);
  for (const auto& [begin, end] : {std::pair{40, 71}, std::pair{0, 13}, std::pair{13, 40}}) {
    depth_normal_rows(depth_m, kCamera, core::CameraPose(), begin, end, parts);
  }
  EXPECT_EQ(whole.pixels(), parts.pixels());
  EXPECT_THROW(depth_normal_rows(depth_m, kCamera, core::CameraPose(), 0, 72, parts),
               core::ContractViolation);
  core::Image<glm::vec3> small(3, 3);
  EXPECT_THROW(depth_normal_rows(depth_m, kCamera, core::CameraPose(), 0, 1, small),
               core::ContractViolation);
}

}  // namespace
}  // namespace segsim::renderer
