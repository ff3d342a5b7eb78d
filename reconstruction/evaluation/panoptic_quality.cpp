#include "reconstruction/evaluation/panoptic_quality.h"

#include <algorithm>
#include <map>

#include "reconstruction/evaluation/internal/segments.h"

namespace segsim::reconstruction {
namespace {

using internal::Segment;
using internal::Segmentation;
using internal::SegmentOverlap;

double segments_of(const ClassPanoptic& c) {
  return static_cast<double>(c.true_positives) +
         0.5 * static_cast<double>(c.false_positives + c.missed);
}

bool more_than_half(std::uint64_t part, std::uint64_t whole) { return 2 * part > whole; }

bool mostly_void(const Segment& segment) {
  return more_than_half(segment.void_pixels, segment.pixels);
}

/// What segments are made from: a view, or the scene.
struct Unit {
  std::vector<Overlap> overlaps;
  std::vector<Label> crowds;  ///< Of the truth.
};

/// For each true segment, whether it is a crowd.
std::vector<bool> crowds_among(const Segmentation& truth, std::span<const Label> crowds) {
  std::vector<bool> is_crowd(truth.segments.size());
  for (const Label& label : crowds) {
    const auto at = truth.index.find(label);
    if (at == truth.index.end() || at->second == internal::kVoid) continue;
    is_crowd[static_cast<std::size_t>(at->second)] = true;
  }
  return is_crowd;
}

/// The evaluated classes that are frequent enough on both sides.
std::vector<core::SceneClass> frequent_classes(std::span<const Overlap> overlaps,
                                               std::span<const core::SceneClass> classes,
                                               double min_share) {
  std::map<std::uint16_t, std::uint64_t> truth, predicted;
  std::uint64_t all = 0;
  for (const Overlap& cell : overlaps) {
    truth[cell.truth.class_id] += cell.pixels;
    predicted[cell.predicted.class_id] += cell.pixels;
    all += cell.pixels;
  }
  std::vector<core::SceneClass> kept;
  const double fewest = min_share * static_cast<double>(all);
  for (const core::SceneClass& c : classes) {
    const std::uint64_t rarer = std::min(truth[c.id], predicted[c.id]);
    if (rarer > 0 && static_cast<double>(rarer) >= fewest) kept.push_back(c);
  }
  return kept;
}

class Counter {
 public:
  Counter(std::span<const core::SceneClass> classes, const PanopticRules& rules)
      : rules_(rules) {
    for (const core::SceneClass& c : classes) {
      class_index_[c.id] = counts_.size();
      counts_.push_back({.class_id = c.id, .thing = c.thing});
    }
  }

  /// Adds the segments of one unit.
  void add(const Unit& unit, std::span<const core::SceneClass> classes) {
    const auto make =
        rules_.segments_by_id ? internal::segments_by_id : internal::segments_by_label;
    Segmentation truth = make(internal::truth_pixels(unit.overlaps), classes);
    Segmentation predicted = make(internal::predicted_pixels(unit.overlaps), classes);
    const std::vector<SegmentOverlap> common = cross(unit.overlaps, truth, predicted);
    const std::vector<bool> crowd =
        crowds_among(truth, rules_.crowds_are_ignored ? std::span<const Label>(unit.crowds)
                                                      : std::span<const Label>());

    std::vector<bool> found(truth.segments.size()), used(predicted.segments.size());
    std::vector<std::uint64_t> crowd_pixels(predicted.segments.size());
    for (const SegmentOverlap& pair : common) {
      const auto g = static_cast<std::size_t>(pair.truth);
      const auto p = static_cast<std::size_t>(pair.predicted);
      if (truth.segments[g].class_id != predicted.segments[p].class_id) continue;
      if (crowd[g]) {
        crowd_pixels[p] += pair.pixels;
        continue;
      }
      const double iou = iou_of(truth.segments[g], predicted.segments[p], pair.pixels);
      if (!(iou > rules_.min_iou)) continue;
      ClassPanoptic& count = counts_of(truth.segments[g]);
      count.iou_sum += iou;
      ++count.true_positives;
      found[g] = used[p] = true;
    }
    for (std::size_t g = 0; g < found.size(); ++g) {
      const bool forgiven = rules_.predicted_void_is_neutral && mostly_void(truth.segments[g]);
      if (!found[g] && !forgiven && !crowd[g]) ++counts_of(truth.segments[g]).missed;
    }
    for (std::size_t p = 0; p < used.size(); ++p) {
      const Segment& segment = predicted.segments[p];
      if (!used[p] && !more_than_half(segment.void_pixels + crowd_pixels[p], segment.pixels)) {
        ++counts_of(segment).false_positives;
      }
    }
  }

  [[nodiscard]] PanopticQuality quality() const;

 private:
  ClassPanoptic& counts_of(const Segment& segment) {
    return counts_[class_index_.at(segment.class_id)];
  }

  [[nodiscard]] double iou_of(const Segment& truth, const Segment& predicted,
                              std::uint64_t common) const {
    std::uint64_t area = truth.pixels + predicted.pixels - common - predicted.void_pixels;
    if (rules_.predicted_void_is_neutral) area -= truth.void_pixels;
    return static_cast<double>(common) / static_cast<double>(area);
  }

  const PanopticRules& rules_;
  std::vector<ClassPanoptic> counts_;
  std::map<std::uint16_t, std::size_t> class_index_;
};

PanopticQuality Counter::quality() const {
  PanopticQuality result{.classes = counts_};
  int counted = 0, things = 0, stuff = 0;
  for (ClassPanoptic& c : result.classes) {
    c.counted = segments_of(c) > 0.0 || rules_.absent_class_is_zero;
    if (!c.counted) continue;
    result.pq += c.pq(), result.sq += c.sq(), result.rq += c.rq();
    (c.thing ? result.pq_things : result.pq_stuff) += c.pq();
    ++counted, ++(c.thing ? things : stuff);
  }
  for (double* sum : {&result.pq, &result.sq, &result.rq}) *sum /= std::max(counted, 1);
  result.pq_things /= std::max(things, 1);
  result.pq_stuff /= std::max(stuff, 1);
  return result;
}

std::vector<Unit> units_of(const ContingencyTable& table, bool per_frame) {
  std::vector<Unit> frames, scene(1);
  for (std::size_t i = 0; i < table.frame_count(); ++i) {
    const auto overlaps = table.frame(i);
    const auto crowds = table.crowds(i);
    frames.push_back({{overlaps.begin(), overlaps.end()}, {crowds.begin(), crowds.end()}});
    scene[0].crowds.insert(scene[0].crowds.end(), crowds.begin(), crowds.end());
  }
  if (per_frame) return frames;
  scene[0].overlaps = table.scene();
  return scene;
}

std::vector<Overlap> without_true_void(std::span<const Overlap> overlaps) {
  std::vector<Overlap> kept;
  std::copy_if(overlaps.begin(), overlaps.end(), std::back_inserter(kept),
               [](const Overlap& cell) { return cell.truth.class_id != 0; });
  return kept;
}

}  // namespace

PanopticRules PanopticRules::strict() { return {}; }

PanopticRules PanopticRules::zju(double min_iou) {
  PanopticRules rules;
  rules.name = "zju";
  rules.min_iou = min_iou;
  rules.segments_by_id = true;
  rules.absent_class_is_zero = true;
  return rules;
}

PanopticRules PanopticRules::panoptic_lifting() {
  PanopticRules rules;
  rules.name = "panoptic-lifting";
  rules.absent_class_is_zero = true;
  rules.predicted_void_is_neutral = true;
  rules.drop_true_void = true;
  rules.min_class_share = 0.005;
  return rules;
}

PanopticRules PanopticRules::coco_per_frame() {
  PanopticRules rules;
  rules.name = "coco-per-frame";
  rules.per_frame = true;
  rules.crowds_are_ignored = true;
  return rules;
}

double ClassPanoptic::pq() const {
  return true_positives == 0 ? 0.0 : iou_sum / segments_of(*this);
}
double ClassPanoptic::sq() const {
  return true_positives == 0 ? 0.0 : iou_sum / static_cast<double>(true_positives);
}
double ClassPanoptic::rq() const {
  return true_positives == 0 ? 0.0 : static_cast<double>(true_positives) / segments_of(*this);
}

PanopticQuality panoptic_quality(const ContingencyTable& table,
                                 std::span<const core::SceneClass> classes,
                                 const PanopticRules& rules) {
  std::vector<Unit> units = units_of(table, rules.per_frame);
  std::vector<core::SceneClass> evaluated(classes.begin(), classes.end());
  if (rules.drop_true_void) {
    for (Unit& unit : units) unit.overlaps = without_true_void(unit.overlaps);
  }
  if (rules.min_class_share > 0.0) {
    std::vector<Overlap> all;
    for (const Unit& unit : units)
      all.insert(all.end(), unit.overlaps.begin(), unit.overlaps.end());
    evaluated = frequent_classes(all, classes, rules.min_class_share);
  }
  Counter counter(evaluated, rules);
  for (const Unit& unit : units) counter.add(unit, evaluated);
  return counter.quality();
}

}  // namespace segsim::reconstruction
