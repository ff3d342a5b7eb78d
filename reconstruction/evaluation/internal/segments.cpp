#include "reconstruction/evaluation/internal/segments.h"

#include <algorithm>

namespace segsim::reconstruction::internal {
namespace {

/// Adds `pixels` to the segment named by `key`, which is made if it is new. @return  Its
/// index.
template <class Key>
int add_to_segment(Segmentation& segmentation, std::map<Key, int>& known, const Key& key,
                   const Segment& segment) {
  const auto [entry, is_new] =
      known.try_emplace(key, static_cast<int>(segmentation.segments.size()));
  if (is_new) {
    segmentation.segments.push_back(segment);
  } else {
    segmentation.segments[static_cast<std::size_t>(entry->second)].pixels += segment.pixels;
  }
  return entry->second;
}

/// Instance id -> class of most of its pixels.
std::map<std::uint16_t, std::uint16_t> majority_classes(const LabelPixels& labels) {
  std::map<std::uint16_t, std::pair<std::uint16_t, std::uint64_t>> best;
  for (const auto& [label, pixels] : labels) {  // Ascending by class: ties keep the lower.
    auto& entry = best[label.instance_id];
    if (pixels > entry.second) entry = {label.class_id, pixels};
  }
  std::map<std::uint16_t, std::uint16_t> classes;
  for (const auto& [id, entry] : best) classes[id] = entry.first;
  return classes;
}

}  // namespace

const core::SceneClass* find_class(std::span<const core::SceneClass> classes,
                                   std::uint16_t class_id) {
  const auto found =
      std::find_if(classes.begin(), classes.end(),
                   [class_id](const core::SceneClass& c) { return c.id == class_id; });
  return found == classes.end() || class_id == 0 ? nullptr : &*found;
}

LabelPixels truth_pixels(std::span<const Overlap> overlaps) {
  LabelPixels labels;
  for (const Overlap& cell : overlaps) labels[cell.truth] += cell.pixels;
  return labels;
}

LabelPixels predicted_pixels(std::span<const Overlap> overlaps) {
  LabelPixels labels;
  for (const Overlap& cell : overlaps) labels[cell.predicted] += cell.pixels;
  return labels;
}

Segmentation segments_by_label(const LabelPixels& labels,
                               std::span<const core::SceneClass> classes) {
  Segmentation result;
  std::map<Label, int> known;
  for (const auto& [label, pixels] : labels) {
    const core::SceneClass* scene_class = find_class(classes, label.class_id);
    if (scene_class == nullptr) {
      result.index[label] = kVoid;
      continue;
    }
    const Label key{label.class_id, scene_class->thing ? label.instance_id : std::uint16_t{0}};
    result.index[label] =
        add_to_segment(result, known, key, {key.class_id, key.instance_id > 0, pixels, 0});
  }
  return result;
}

Segmentation segments_by_id(const LabelPixels& labels,
                            std::span<const core::SceneClass> classes) {
  // The key of a segment: (class, 0) without an id, (0, id) of a thing, (class, 1) of stuff
  // that carries ids, which stays apart from stuff that carries none.
  const std::map<std::uint16_t, std::uint16_t> majority = majority_classes(labels);
  Segmentation result;
  std::map<Label, int> known;
  for (const auto& [label, pixels] : labels) {
    const bool has_id = label.instance_id > 0;
    const std::uint16_t class_id = has_id ? majority.at(label.instance_id) : label.class_id;
    const core::SceneClass* scene_class = find_class(classes, class_id);
    if (scene_class == nullptr) {
      result.index[label] = kVoid;
      continue;
    }
    const bool thing_instance = has_id && scene_class->thing;
    const Label key = thing_instance
                          ? Label{0, label.instance_id}
                          : Label{class_id, static_cast<std::uint16_t>(has_id ? 1 : 0)};
    result.index[label] =
        add_to_segment(result, known, key, {class_id, thing_instance, pixels, 0});
  }
  return result;
}

std::vector<SegmentOverlap> cross(std::span<const Overlap> overlaps, Segmentation& truth,
                                  Segmentation& predicted) {
  std::map<std::pair<int, int>, std::uint64_t> common;
  for (const Overlap& cell : overlaps) {
    const int g = truth.index.at(cell.truth), p = predicted.index.at(cell.predicted);
    if (g != kVoid && p != kVoid) {
      common[{g, p}] += cell.pixels;
    } else if (p != kVoid) {
      predicted.segments[static_cast<std::size_t>(p)].void_pixels += cell.pixels;
    } else if (g != kVoid) {
      truth.segments[static_cast<std::size_t>(g)].void_pixels += cell.pixels;
    }
  }
  std::vector<SegmentOverlap> result;
  result.reserve(common.size());
  for (const auto& [pair, pixels] : common)
    result.push_back({pair.first, pair.second, pixels});
  return result;
}

}  // namespace segsim::reconstruction::internal
