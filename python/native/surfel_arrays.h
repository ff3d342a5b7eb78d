#pragma once

/// @file
/// Surfels as the numbers that training changes (docs/python_training.md), as NumPy arrays: of
/// a scene, and a scene of them.

#include <nanobind/nanobind.h>

#include "python/native/scene.h"

namespace segsim::python {

/// Adds surfel_parameters(), from_parameters() and save().
void bind_surfel_arrays(nanobind::class_<Scene>& scene);

}  // namespace segsim::python
