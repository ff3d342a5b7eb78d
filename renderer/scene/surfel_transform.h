#pragma once

/// @file
/// Moves a scene rigidly: p' = R p + t. A camera that moves along sees the same picture.

#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>

#include "renderer/scene/panoptic_field.h"
#include "renderer/scene/surfels.h"

namespace segsim::renderer {

/// Positions, orientations and colours: harmonics are turned with the scene (each band by its
/// own matrix, found by exact quadrature over the sphere). Features, labels and sizes stay.
/// @param R  Unit.
void transform_surfels(const glm::dquat& R, const glm::dvec3& t_m, SurfelCloud& surfels);

/// Positions and orientations of the queries.
void transform_panoptic_model(const glm::dquat& R, const glm::dvec3& t_m,
                              PanopticModel& model);

}  // namespace segsim::renderer
