#pragma once

/// @file
/// Single surfels of every awkward kind before a camera at the origin that looks along +z, for
/// property tests.

#include <cmath>

#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

#include "core/random.h"

namespace segsim::renderer::testing {

enum AwkwardKind {
  kOrdinary,
  kTiny,
  kHuge,
  kEdgeOn,           ///< The eye lies in the disc's plane, or next to it.
  kAroundTheCamera,  ///< The camera is inside the ball of the disc's radius.
  kFaint,            ///< Opacity within 1e-3 of 1/255.
  kSlender,
  kBehind,  ///< The centre lies behind the camera, the disc may reach before it.
  kAwkwardKinds
};

struct AwkwardDisc {
  glm::dvec3 centre_m, normal;
  glm::dvec3 u, v;  ///< Unit tangents; (u, v, normal) is right-handed.
  double scale_u_m, scale_v_m, opacity;
};

inline glm::dvec3 random_direction(core::RandomStream& random) {
  const double x = random.normal(), y = random.normal(), z = random.normal();
  return glm::normalize(glm::dvec3(x, y, z));
}

/// Centres lie in a pyramid of about 70 x 60 degrees, 6 cm to 6 m away.
inline AwkwardDisc random_awkward_disc(core::RandomStream& random, AwkwardKind kind) {
  const double x = random.uniform(-0.7, 0.7), y = random.uniform(-0.6, 0.6);
  glm::dvec3 centre = random.uniform(0.06, 6.0) * glm::dvec3(x, y, 1.0);
  double su = std::exp(random.uniform(-6.0, -1.5)), sv = su * std::exp(random.normal());
  glm::dvec3 normal = random_direction(random);
  double opacity = random.uniform(0.02, 1.0);
  switch (kind) {
    case kTiny:
      su *= 1e-4, sv *= 1e-4;
      break;
    case kHuge:
      su *= 30.0, sv *= 30.0;
      break;
    case kSlender:
      sv = 1e-3 * su;
      break;
    case kFaint:
      opacity = (1.0 + random.uniform(-1e-3, 1e-3)) / 255.0;
      break;
    case kEdgeOn:
      normal = glm::normalize(glm::cross(centre, random_direction(random)));
      normal += random.uniform(-1e-5, 1e-5) * glm::normalize(centre);
      break;
    case kAroundTheCamera:
      su = random.uniform(0.4, 2.0) * glm::length(centre), sv = su;
      break;
    case kBehind:
      centre.z = -centre.z;
      su = random.uniform(0.1, 2.0) * glm::length(centre), sv = su;
      break;
    default:
      break;
  }
  normal = glm::normalize(normal);
  const glm::dvec3 u = glm::normalize(glm::cross(normal, random_direction(random)));
  return {centre, normal, u, glm::cross(normal, u), su, sv, opacity};
}

}  // namespace segsim::renderer::testing
