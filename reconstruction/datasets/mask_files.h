#pragma once

/// @file
/// Folders of per-view masks, as a 2-D segmenter leaves them. Frame names are those of the
/// recording. docs/masks.md has examples.
///
///     segsim        masks.yaml, and for each view  <n>_sem.png   8 or 16 bit, class id
///                   <n>_ins.png  16 bit, id in the view, 0 = none
///                   <n>_conf.png score * 255
///                   <n>.json     [{"id", "label", "score", "area", "bbox": [x, y, w, h],
///                   "iscrowd"}, ...]; iscrowd is 0 unless it is there
///     grounded-sam  <n>.png  8 or 16 bit, value of the mask; <n>.json  [{"value", "label",
///                   "logit"}, ...] or {"mask": [...]}, where value 0 is the background
///     panoptic-recon  semantic_image/<n>.png, instance_image/<n>.png: 8 or 16 bit ids
///
/// COCO's panoptic format has a file of its own (coco_panoptic.h).

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/frame_masks.h"
#include "core/scene_bundle.h"

namespace segsim::reconstruction {

enum class MaskLayout : std::uint8_t { kSegsim, kGroundedSam, kPanopticRecon, kCocoPanoptic };

/// masks.yaml: what holds for all views.
struct MaskSetInfo {
  std::string source;  ///< In words: which segmenter, or "simulated".
  std::vector<core::SceneClass> classes;
  std::vector<std::string> prompts;  ///< As given to the segmenter; may be empty.
  /// Settings and measured quality: name, value.
  std::vector<std::pair<std::string, double>> settings, measured;
};

/// Read-only. May be used by many threads at once.
class MaskSet {
 public:
  virtual ~MaskSet() = default;
  MaskSet() = default;
  MaskSet(const MaskSet&) = delete;
  MaskSet& operator=(const MaskSet&) = delete;

  [[nodiscard]] virtual MaskLayout layout() const = 0;
  [[nodiscard]] virtual const MaskSetInfo& info() const = 0;
  /// Names of the views, ascending.
  [[nodiscard]] virtual const std::vector<std::string>& names() const = 0;
  /// Masks of one view.
  /// @param width_px, height_px  Of the recording's images.
  /// @throws InputError naming the file: it is missing or damaged, has another size, an id
  /// without an entry, an entry without a class, a score outside [0, 1]. In the grounded-sam
  /// layout labels that are no class of the scene become void instead: prompts may be richer.
  [[nodiscard]] virtual core::FrameMasks read(const std::string& name, int width_px,
                                              int height_px) const = 0;
  /// The same at whatever size the files have.
  [[nodiscard]] virtual core::FrameMasks read_as_stored(const std::string& name) const = 0;
};

/// Whether a folder is a set of masks in the segsim layout (else, say, a recording).
[[nodiscard]] bool is_mask_set(const std::filesystem::path& folder);

/// Opens a folder in whichever layout it has.
/// @param classes  Of the scene; for the layouts that bring no table of their own. With
/// masks.yaml they must agree with it, unless empty: an id has one name in both, and a name
/// one id; either may have classes that the other has not.
/// @throws InputError if no layout fits, or masks.yaml is broken.
[[nodiscard]] std::unique_ptr<MaskSet> open_masks(
    const std::filesystem::path& folder, const std::vector<core::SceneClass>& classes = {});

/// Writes one view in the segsim layout, each file atomically.
/// @param classes  Give the labels of the JSON file.
void write_masks(const std::filesystem::path& folder, const std::string& name,
                 const core::FrameMasks& masks, const std::vector<core::SceneClass>& classes);

/// Reads masks.yaml.
/// @throws InputError naming line and key: unknown keys, another schema, broken classes.
[[nodiscard]] MaskSetInfo read_mask_set_info(const std::filesystem::path& file);

/// Writes masks.yaml. Written last, it says that the set is complete.
void write_mask_set_info(const std::filesystem::path& folder, const MaskSetInfo& info);

}  // namespace segsim::reconstruction
