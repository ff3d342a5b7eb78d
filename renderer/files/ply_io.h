#pragma once

/// @file
/// Surfel scenes on disk, in the layout of the official 2DGS code (Huang et al. 2024): one PLY
/// element `vertex` with
///
///     x y z  nx ny nz  f_dc_0..2  f_rest_*  opacity  scale_0 scale_1  rot_0..3
///
/// Values are stored before activation: scale = exp(scale_i) [m], opacity = sigmoid(opacity),
/// rotation = normalised (w, x, y, z). f_rest is channel-major: all red coefficients of degree
/// >= 1, then green, then blue; 3 ((L+1)^2 - 1) of them give degree L. Labelled scenes carry
/// two more properties of ours, `ushort semantic_id` and `ushort instance_id`; scenes with a
/// trained panoptic field carry `float sem_f_0..15` and `float ins_f_0..31`, all or none.

#include <filesystem>

#include "renderer/scene/surfels.h"

namespace segsim::renderer {

/// Reads ASCII or binary little-endian files, properties found by name in any order.
/// Properties that are not needed (normals, a third scale of 3DGS viewers, ...) are skipped.
/// @throws core::InputError naming the property, or the byte counts of a truncated file, or
/// the
///     surfel with an unusable value.
[[nodiscard]] SurfelCloud read_surfels_ply(const std::filesystem::path& file);

/// Writes binary little-endian, normals zero. Reading it back gives the same scene within
/// float rounding; an opacity of 1 comes back as 1 - 6e-8.
void write_surfels_ply(const std::filesystem::path& file, const SurfelCloud& surfels);

}  // namespace segsim::renderer
