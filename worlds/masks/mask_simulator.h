#pragma once

/// @file
/// Exact labels -> masks as an open-vocabulary segmenter would give them (GroundingDINO boxes,
/// one SAM mask per box): objects missed, merged, split, found twice or made up, borders that
/// wobble and leak, classes confused, and ids that mean nothing beyond the view.
///
///     truth -> merge -> miss -> border -> leak or loss -> confuse -> split, duplicate
///           -> add hallucinations -> paint by ascending score -> random ids
///
/// Rates are fitted to published figures of such masks on three ScanNet++ scenes (per view and
/// at IoU > 0.3: PQ 53.5, SQ 81.6, RQ 65.1, recall 0.73, precision 0.61); docs/masks.md says
/// how, and what is unlike the real thing. Masks made here are simulated masks, and tables
/// must say so.

#include <cstdint>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/frame_masks.h"
#include "core/frames.h"
#include "core/scene_bundle.h"
#include "worlds/masks/mask_noise.h"

namespace segsim::worlds {

/// A view with exact labels; borrowed for the call.
struct ExactView {
  const core::Image<std::uint16_t>& semantic;
  const core::Image<std::uint16_t>& instance;
  core::CameraPose T_world_camera;
  core::CameraIntrinsics intrinsics;  ///< Of the label images.
  std::uint32_t frame = 0;            ///< Number in the recording, in order of time.
};

/// All draws are named by (seed, scene, frame, object), so that a view's masks depend on
/// nothing else: not on the other views, their order, or the number of threads.
class MaskSimulator {
 public:
  /// @param classes  Every class of the recording; hallucinations and confusions draw from
  /// them.
  /// @param scene  Part of every draw.
  MaskSimulator(std::vector<core::SceneClass> classes, const MaskNoise& noise,
                std::uint64_t seed, const std::string& scene);

  /// True classes that are not listed are void. May be called by many threads at once.
  [[nodiscard]] core::FrameMasks simulate(const ExactView& view) const;

  [[nodiscard]] const MaskNoise& noise() const { return noise_; }
  [[nodiscard]] const std::vector<core::SceneClass>& classes() const { return classes_; }

 private:
  std::vector<core::SceneClass> classes_;
  MaskNoise noise_;
  std::uint64_t seed_;
};

}  // namespace segsim::worlds
