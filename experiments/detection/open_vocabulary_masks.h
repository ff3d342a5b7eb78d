#pragma once

/// @file
/// Grounded-SAM style masks (Ren et al. 2024) from models that the user brings:
///
///     image --detector(prompt)--> boxes --segmenter--> one mask per box --compose-->
///     FrameMasks
///
/// in the layout that reconstructions learn from (reconstruction/datasets/mask_files.h).

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/frame_masks.h"
#include "core/scene_bundle.h"
#include "perception/models/prompt_segmenter.h"
#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::experiments::detection {

/// Paints masks by ascending score, so that the surest is on top. Things get ids 1, 2, ... in
/// descending score; masks of one stuff class share id 0. The score of a mask is the
/// detection's; what is hidden by others keeps no segment.
/// @param masks  One per detection, of the image's size.
/// @param classes  Class of each Detection::class_index.
[[nodiscard]] core::FrameMasks compose_masks(int width_px, int height_px,
                                             const std::vector<core::Detection>& detections,
                                             const std::vector<perception::PromptMask>& masks,
                                             const std::vector<core::SceneClass>& classes);

/// A class for each phrase: the recording's of that name where it has classes, else 1, 2, ...
/// @throws core::InputError if a phrase is no class of a recording that has classes, or a
/// phrase of `stuff` is not in the prompt.
[[nodiscard]] std::vector<core::SceneClass> prompt_classes(
    const std::vector<std::string>& phrases, const std::vector<std::string>& stuff,
    const std::vector<core::SceneClass>& recorded, const std::string& place);

struct DetectMasksOptions {
  std::filesystem::path detector, segmenter;  ///< Models (docs/models.md).
  std::string prompt;                         ///< "chair. table."
  std::string stuff;                          ///< Phrases of the prompt without instances.
  std::optional<float> score_threshold;
  std::filesystem::path output;
  int frame_step = 1;
};

struct DetectMasksReport {
  std::size_t views = 0, masks = 0;
};

/// Writes the masks of a recording; masks.yaml last.
DetectMasksReport detect_masks(const reconstruction::RgbdSequence& recording,
                               const DetectMasksOptions& options);

}  // namespace segsim::experiments::detection
