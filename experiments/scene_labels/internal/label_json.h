#pragma once

/// @file
/// What the page is told, and what it asks for.

#include <map>
#include <string>

#include "experiments/scene_labels/internal/label_views.h"
#include "experiments/scene_labels/label_editor.h"

namespace segsim::experiments::scene_labels::internal {

/// Classes, instances with their surfels and colours, what can be undone.
[[nodiscard]] std::string scene_json(const LabelEditor& editor, const std::string& said);
/// The recording's cameras, and where a first look is taken from.
[[nodiscard]] std::string cameras_json(const core::CameraPath& cameras,
                                       const LabelEditor& editor);
[[nodiscard]] std::string picked_json(const PickedPixel& picked);

/// @param query  camera=N, or x, y, z [m], yaw, pitch [rad]; width [px].
/// @throws core::InputError for what is no number.
[[nodiscard]] ViewRequest view_of(const std::map<std::string, std::string>& query);
/// A number of the query. @throws core::InputError if it is missing or none.
[[nodiscard]] double query_number(const std::map<std::string, std::string>& query,
                                  const std::string& key);

/// Another page, or an older one, does not know what the labels are now.
struct StaleRevision {};

/// Does what a POST asks for:
///
///     {"revision": N, "do": "rename", "instance": I, "class": "bed", "thing": true,
///      "name": "..."}    thing, name: may be missing
///
///     "merge" instance, into; "pieces" instance, gap_m; "delete" instance; "undo"; "redo";
///
///     "cut" instance, gap_m, seeds: [[part, x, y, z], ...]
///
/// @return  What was done, in words.
/// @throws core::InputError for a body that is none of these.  @throws StaleRevision
std::string do_edit(LabelEditor& editor, const std::string& body);

}  // namespace segsim::experiments::scene_labels::internal
