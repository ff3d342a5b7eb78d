#pragma once

#include <optional>
#include <span>

#include <glm/vec3.hpp>

namespace segsim::reconstruction {

/// Height of the floor in a cloud with z up: the lowest horizontal plane (within 8 degrees)
/// among the large ones (RANSAC) that has next to nothing below it.
/// @return nullopt if no such plane exists.
[[nodiscard]] std::optional<double> fit_floor_height_m(std::span<const glm::vec3> points_m);

}  // namespace segsim::reconstruction
