#pragma once

/// @file
/// A training set and its first surfels in one file: all that training reads, for GPU machines
/// without the libraries that read recordings (tools/train_pack.cpp).
/// Little-endian, uncompressed; the machine's own layout of IEEE-754 floats:
///
///     8 bytes  "SEGSIMTP"
///
///     i32      version = 2, width, height; f64 fx, fy, cx, cy [px]
///
///     i32      classes; each: u16 id, u16 thing (0 or 1)
///
///     i32      views; each: i32 held_out (0 or 1), i64 frame (of the recording),
///
///              f64 R_world_camera[4] (w x y z), f64 position_m[3],
///
///              u8 rgb[3 n], f32 depth_m[n], u16 semantic[n], u16 instance[n],
///
///              u8 confidence[n], n = width height
///
///     i64      surfels; f32 position_m[3 m], log_scale[2 m], rotation[4 m] (w x y z),
///
///              opacity_logit[m], sh[3 m]

#include <filesystem>

#include "reconstruction/training/training_set.h"
#include "renderer/scene/surfels.h"

namespace segsim::reconstruction {

struct TrainingPack {
  TrainingSet set;
  renderer::SurfelCloud start;  ///< SH degree 0, without labels.
};

/// @throws core::ContractViolation for views without depth or masks.
void write_training_pack(const std::filesystem::path& file, const TrainingSet& set,
                         const renderer::SurfelCloud& start);
/// @throws core::InputError for a file that is missing, of another kind, or too short.
[[nodiscard]] TrainingPack read_training_pack(const std::filesystem::path& file);

}  // namespace segsim::reconstruction
