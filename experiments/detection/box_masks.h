#pragma once

/// @file
/// Masks of single views without a segmenter: the boxes of any detector become masks by depth
/// and colour (reconstruction/segmentation/box_segmenter.h), and floor, walls and ceiling come
/// from the recording's shape (room_parts.h). Written in the layout that reconstructions learn
/// from (reconstruction/datasets/mask_files.h); what neither is stays void, or becomes the
/// stuff class "other".

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/frame_masks.h"
#include "core/scene_bundle.h"
#include "core/stages.h"
#include "reconstruction/datasets/rgbd_sequence.h"
#include "reconstruction/segmentation/box_segmenter.h"
#include "reconstruction/segmentation/room_parts.h"

namespace segsim::experiments::detection {

/// Ids of the classes that a view without a segmenter can have.
struct BoxMaskClasses {
  std::vector<core::SceneClass> table;  ///< Ascending by id; those that occur.
  std::vector<std::uint16_t> of_class;  ///< By Detection::class_index.
  std::uint16_t floor = 0, wall = 0, ceiling = 0, other = 0;  ///< 0: not wanted.
};

/// Names keep the recording's ids where it has them; others follow behind.
/// @param detected  Class names of the detector.
/// @param room  Whether floor, wall and ceiling are wanted.
/// @param other  Whether what is nothing else is.
/// @throws core::InputError if a detected class has the name of one of those.
[[nodiscard]] BoxMaskClasses box_mask_classes(const std::vector<std::string>& detected,
                                              const std::vector<core::SceneClass>& recorded,
                                              bool room, bool other);

/// How sure a mask is that no detector scored.
struct RoomScores {
  float room = 0.8F;   ///< Of floor, walls and ceiling.
  float other = 0.2F;  ///< Of measured surfaces that are nothing else.
};

/// One view: other, then the room's parts, then things by ascending score, so that the surest
/// is on top. Things get ids 1, 2, ... in descending score. A thing of which surer ones hide
/// more than half is left out: it is the same object under another name.
/// @param masks  One per detection, of the image's size, 1 inside.
/// @param parts  Of the image's size.
/// @param depth_m  Of the image's size, NaN = unknown; only measured pixels become "other".
[[nodiscard]] core::FrameMasks paint_box_masks(
    const std::vector<core::Detection>& detections,
    const std::vector<core::Image<std::uint8_t>>& masks,
    const core::Image<reconstruction::RoomPart>& parts, const core::Image<float>& depth_m,
    const BoxMaskClasses& classes, const RoomScores& scores);

/// A detector by file: weights of this program, or a model of others (docs/models.md).
/// @param prompt  "chair. couch.": classes to look for; empty: all of the detector's.
/// @throws core::InputError for a broken file, a class that it does not have, and for a
///     detector that needs a prompt and got none.
[[nodiscard]] std::unique_ptr<core::Detector> open_detector(
    const std::filesystem::path& file, const std::string& prompt,
    std::optional<float> score_threshold);

struct BoxMaskOptions {
  std::filesystem::path detector;
  std::string prompt;                    ///< Empty: all classes of the detector.
  std::optional<float> score_threshold;  ///< Default: the detector's own.
  bool room = true;                      ///< Floor, wall and ceiling as stuff.
  bool other = false;                    ///< Everything else that was measured, as stuff.
  RoomScores scores;
  reconstruction::BoxSegmenterOptions segmenter;
  reconstruction::RoomPartOptions parts;
  std::filesystem::path output;
  int frame_step = 1;
};

/// All that decides the masks, in one line.
[[nodiscard]] std::string describe(const BoxMaskOptions& options,
                                   const reconstruction::RgbdSequence& recording);

struct BoxMaskReport {
  std::size_t views = 0, kept = 0;  ///< `kept` of them were there already.
  std::vector<core::SceneClass> classes;
  std::vector<std::size_t> masks;  ///< By class, in the order of `classes`.
};

/// Floor, walls and ceiling by the depth of up to 240 frames spread over the recording.
/// @throws core::InputError if no frame has depth.
[[nodiscard]] reconstruction::RoomParts find_room_parts(
    const reconstruction::RgbdSequence& recording,
    const reconstruction::RoomPartOptions& options = {});

/// Writes the masks of every n-th frame; masks.yaml last. Views that an interrupted run of the
/// same settings left (recipe.txt) are kept.
/// @throws core::InputError for frames without depth, or a folder with masks of other
///     settings.
BoxMaskReport make_box_masks(const reconstruction::RgbdSequence& recording,
                             const BoxMaskOptions& options);

/// Removes the views, masks.yaml and recipe.txt that make_box_masks() wrote, and nothing else.
/// @throws core::InputError if the folder has masks but no recipe.txt: others made them.
void remove_box_masks(const std::filesystem::path& folder);

/// Photographs of up to `views` views, spread evenly, with their masks drawn over them.
[[nodiscard]] core::Image<core::Rgb8> box_mask_sheet(
    const reconstruction::RgbdSequence& recording, const std::filesystem::path& masks,
    int frame_step, int views = 12);

}  // namespace segsim::experiments::detection
