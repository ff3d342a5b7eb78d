#pragma once

/// @file
/// How good a reconstruction is on views that it has not seen.

#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/process/measurement_record.h"
#include "core/render.h"
#include "reconstruction/evaluation/contingency.h"
#include "reconstruction/evaluation/image_quality.h"
#include "reconstruction/evaluation/panoptic_quality.h"
#include "reconstruction/training/training_set.h"

namespace segsim::reconstruction {

struct HeldOutQuality {
  ColorQuality color;
  /// The same views after each channel was given the gain that fits best (gain_fitted()): of
  /// a recording with automatic exposure. A figure of its own, not to be quoted as the first.
  ColorQuality gain_fitted_color;
  /// The same views at the exposure between those that training found for the frames before
  /// and after; the views' own pictures have no part in it. Without views if training had no
  /// rate for exposure.
  ColorQuality exposed_color;
  DepthQuality depth;  ///< Against the recorded depth.
  /// Recorded depth of the nearest training frame before and after, brought into the view
  /// (depth_repeatability.h), against the recorded depth: the sensor's own level ...
  DepthQuality sensor_depth;
  DepthQuality depth_at_sensor;  ///< ... and `depth` on the same pixels.
  NormalQuality normal;          ///< Against the normals of the recorded depth.
  ContingencyTable labels;       ///< Without frames if there are no true labels.
  PanopticQuality panoptic;      ///< Strict rules, of the whole scene.
  double mean_iou = 0.0;         ///< Pooled over the views.

  /// For the manifest: prefix + "psnr_db", ...; empty without held-out views.
  [[nodiscard]] std::vector<std::pair<std::string, double>> listing(
      const std::string& prefix = "held_out_") const;
  /// For a record of results/, in the row `case_name`: what was measured, with units.
  [[nodiscard]] std::vector<core::MeasuredValue> measured(const std::string& case_name) const;
  /// One line for people.
  [[nodiscard]] std::string text() const;
};

/// What training found out about a recording beside its surfels.
struct TrainedCamera {
  std::vector<core::CameraPose> held_out_poses;  ///< Empty: as recorded.
  std::vector<Exposure> exposures;               ///< Of the training views; may be empty.
};

/// Draws every held-out view of the set.
[[nodiscard]] HeldOutQuality held_out_quality(core::Renderer& renderer, const TrainingSet& set,
                                              const TrainedCamera& camera = {});

/// For a frame that was not trained on: linear between those of the training views just
/// before and after it; of the nearest one at an end.
/// @param exposures  Of the training views, not empty.
[[nodiscard]] Exposure exposure_between(const TrainingSet& set,
                                        const std::vector<Exposure>& exposures,
                                        std::size_t frame);

/// Labels of the views on the training trajectory against `truth`, view by view.
/// @param truth  Exact labels of a training view, of the set's size.
[[nodiscard]] ContingencyTable trajectory_labels(
    core::Renderer& renderer, const TrainingSet& set,
    const std::function<core::FrameMasks(const TrainingView&)>& truth);

}  // namespace segsim::reconstruction
