#pragma once

/// @file
/// Every weight and rate of training, and the one YAML file that sets them. defaults.yaml
/// lists all keys with their default, meaning and source; a file given by the user may name
/// any subset of them.

#include <cstdint>
#include <filesystem>
#include <string>

#include "reconstruction/labels/panoptic_config.h"

namespace segsim::reconstruction {

/// Shape and colour. Shares are of the iterations, so that a short run keeps the order of
/// events. Sources are in defaults.yaml.
struct GeometryConfig {
  std::int64_t iterations = 3000;  ///< One image each.
  int sh_degree = 1;               ///< Of the result, 0 ... 3.
  double sh_grow_every = 0.2;      ///< Share of training between two degrees.

  struct Loss {
    double ssim = 0.2;  ///< Share of 1 - SSIM beside L1.
    double depth = 0.1;
    double normal = 0.05;
    double distortion = 0.0;
    double plane = 0.0;  ///< L_sdf of the paper, on surfels: 0 = off.
    double plane_truncation_m = 0.15;
    double normal_from = 0.0;                      ///< Share of training.
    double distortion_from = 0.1;                  ///< Share of training.
    double min_depth_m = 0.1, max_depth_m = 10.0;  ///< Of the sensor.
  } loss;

  /// Adam. Positions: times the extent of the camera path.
  struct Rate {
    double position = 1.6e-4, position_final = 1.6e-6;
    double color = 2.5e-3, color_rest = 1.25e-4;
    double opacity = 0.02, log_scale = 5e-3, rotation = 1e-3;
    double exposure = 0.0;  ///< 0 = no exposure compensation.
    /// Of poses: [rad] and [m] of a steady step, 1 % of it at the end; 0 = poses as recorded.
    double pose_rotation = 0.0, pose_translation = 0.0;
  } rate;

  struct Densify {
    /// Shares of training. Between two changes every view is drawn at least once.
    double from = 0.1, until = 0.6, every = 0.05;
    double min_gradient = 4e-4;  ///< Mean screen gradient of the split ones.
    double max_growth = 0.05;    ///< Of the count, each time.
    std::int64_t max_surfels = 1'000'000;
    double min_scale_m = 0.003;     ///< Smaller surfels are not split.
    double min_opacity = 0.05;      ///< Fainter surfels go.
    double min_weight = 0.01;       ///< Surfels below this in all views go.
    double max_scale_extent = 0.1;  ///< Larger surfels (share of the extent) go.
    double prune_until = 0.9;       ///< Share of training.
    bool fill_holes = true;         ///< New surfels where a view shows none.
  } densify;
};

/// Head training for two cores: a fifth of the images and half of the pixels, so everything
/// moves faster.
[[nodiscard]] PanopticTrainingConfig short_panoptic_config();

/// Labels and surfels trained together (joint_training.h). Ours.
struct JointConfig {
  double labels = 0.1;  ///< Factor of label losses where they reach the surfels.
  double rate = 1.0;    ///< Of the surfels' rates at the end of their own training.
};

struct TrainingConfig {
  GeometryConfig geometry;
  PanopticTrainingConfig panoptic = short_panoptic_config();
  JointConfig joint;
};

/// @throws core::InputError naming file, line and key: unknown keys, wrong types, values out
/// of
///     range.
[[nodiscard]] TrainingConfig read_training_config(const std::filesystem::path& file);
/// The same from memory. @param origin  Stands for the file in messages.
[[nodiscard]] TrainingConfig parse_training_config(const std::string& text,
                                                   const std::string& origin);

/// All keys with their values, as YAML; equal configurations give equal text.
[[nodiscard]] std::string training_config_text(const TrainingConfig& config);

}  // namespace segsim::reconstruction
