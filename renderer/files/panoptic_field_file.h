#pragma once

/// @file
/// The label distribution of every surfel as a file: what fold_panoptic_model() computes,
/// kept, so that a scene is drawn with the labels it was trained to without its features,
/// decoder or queries. Numbers are kept exactly: the same field comes back, and the same
/// pictures.

#include <filesystem>

#include "renderer/scene/panoptic_field.h"

namespace segsim::renderer {

/// Name of the file in a bundle.
inline constexpr const char* kPanopticFieldFileName = "labels.bin";

/// Layout of internal/checked_file.h, magic "SEGSIMLD", version 1; little-endian, floats are
/// IEEE-754 single precision (statistics double). Payload:
///
///     u32 surfels, u32 classes, u32 instances
///
///     u32 row capacity of classes, u32 of instances, u32 1 if instances have classes
///
///     f64[4] mean and largest dropped mass of classes, of instances
///
///     class: u16 id, u16 thing (0 or 1)
///
///     instance: u16 id, u16 class (0 without)
///
///     surfel, twice (classes, instances): f32 base, u16 entries, entry: u16 index, f32 excess
void write_panoptic_field(const std::filesystem::path& file, const PanopticField& field);

/// @param surfels  That the scene has.
/// @throws core::InputError for a file that is missing, damaged, newer, of another number of
///     surfels, or whose values are out of range.
[[nodiscard]] PanopticField read_panoptic_field(const std::filesystem::path& file,
                                                std::size_t surfels);

}  // namespace segsim::renderer
