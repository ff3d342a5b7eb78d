#pragma once

/// @file
/// What 2-D masks are worth, measured against exact labels, and noise fitted to a wanted
/// quality.

#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "core/frame_masks.h"
#include "reconstruction/datasets/rgbd_sequence.h"
#include "reconstruction/evaluation/panoptic_quality.h"
#include "reconstruction/evaluation/view_quality.h"
#include "worlds/masks/mask_simulator.h"

namespace segsim::experiments::training {

/// Exact labels of one view, kept in memory.
struct TrueLabels {
  core::Image<std::uint16_t> semantic, instance;
  std::vector<reconstruction::Label> crowds;
  core::CameraPose T_world_camera;
  std::uint32_t frame = 0;

  [[nodiscard]] reconstruction::LabelImages images() const {
    return {semantic, instance, crowds};
  }
  [[nodiscard]] worlds::ExactView view(const core::CameraIntrinsics& intrinsics) const {
    return {semantic, instance, T_world_camera, intrinsics, frame};
  }
};

/// @throws InputError if the recording has no labels.
[[nodiscard]] TrueLabels load_true_labels(const reconstruction::RgbdSequence& recording,
                                          std::size_t i);

/// Figures of a set of masks.
struct MaskQuality {
  reconstruction::ViewQuality views;
  reconstruction::PanopticQuality coco,
      strict;  ///< Of single views at IoU > 0.5; of the scene.

  /// Name and value, for masks.yaml; shares in [0, 1].
  [[nodiscard]] std::vector<std::pair<std::string, double>> listing() const;
};

[[nodiscard]] MaskQuality mask_quality(const reconstruction::ContingencyTable& table,
                                       std::span<const core::SceneClass> classes,
                                       int width_px);

/// The published quality of Grounded-SAM masks on three ScanNet++ scenes.
[[nodiscard]] reconstruction::ViewQuality published_quality();

/// Rows per set of masks, the last one what was published; in percent.
[[nodiscard]] std::string mask_quality_text(const std::string& name,
                                            const MaskQuality& quality);

/// From the class ids of one table to those of another, by name.
struct ClassTranslation {
  std::vector<std::uint16_t>
      id_of;  ///< By id of the first table; 0: the second has no such class.
  std::vector<std::string> common;   ///< Names in both, in the order of the second.
  std::vector<std::string> unknown;  ///< Names that only the first has.

  /// Translates classes. What has none in the second table is void, without an instance.
  void apply(core::Image<std::uint16_t>& semantic, core::Image<std::uint16_t>& instance) const;
};
[[nodiscard]] ClassTranslation translate_classes(std::span<const core::SceneClass> from,
                                                 std::span<const core::SceneClass> to);

/// One row for each class in `names`, and their means; [0, 1].
struct ClassRow {
  std::string name;
  double pq = 0.0, sq = 0.0, rq = 0.0;
  std::uint64_t true_positives = 0, false_positives = 0, missed = 0;
};
/// @param classes  The table that `quality` was computed for, in its order.
/// @return  A row for each counted class of these names, then "things", "stuff" and "all":
///     means over those classes. Those without a counted class are left out.
[[nodiscard]] std::vector<ClassRow> class_rows(const reconstruction::PanopticQuality& quality,
                                               std::span<const core::SceneClass> classes,
                                               const std::vector<std::string>& names);
/// @param heading  Of the first column.
[[nodiscard]] std::string class_rows_text(const std::string& heading,
                                          const std::vector<ClassRow>& rows);

/// Scales misses, false positives and shapes of `noise` until RQ and SQ of the given views are
/// within `tolerance` of the target, with its balance of recall and precision; at most twelve
/// rounds.
/// @param note  Called after each round with what was reached.
[[nodiscard]] worlds::MaskNoise fit_mask_noise(
    const worlds::MaskNoise& noise, const std::vector<core::SceneClass>& classes,
    std::uint64_t seed, const std::string& scene, std::span<const TrueLabels> views,
    const core::CameraIntrinsics& intrinsics, const reconstruction::ViewQuality& target,
    double tolerance, const std::function<void(const reconstruction::ViewQuality&)>& note);

/// What noisy masks are made of.
struct MaskSimulation {
  worlds::MaskNoise noise;  ///< At level 1.
  double level = 1.0;
  bool fit = false;  ///< First scale the noise until views give the published quality.
  std::uint64_t seed = 1;
  int frame_step = 1;
};

/// "simulated, level 1, fitted, seed 1".
[[nodiscard]] std::string describe(const MaskSimulation& simulation);

/// Spoils the recording's exact labels and writes the masks of every n-th frame, masks.yaml
/// last.
/// @param on_view  Gets truth and masks of every view; may be empty.
MaskQuality simulate_masks(
    const reconstruction::RgbdSequence& recording, const MaskSimulation& simulation,
    const std::filesystem::path& folder,
    const std::function<void(const TrueLabels&, const core::FrameMasks&)>& on_view = {});

}  // namespace segsim::experiments::training
