#include "reconstruction/evaluation/semantic_quality.h"

#include <algorithm>
#include <map>

namespace segsim::reconstruction {
namespace {

/// Pixels of one class among the valid ones.
struct ClassPixels {
  std::uint64_t correct = 0, truth = 0, predicted = 0;

  [[nodiscard]] std::uint64_t either() const { return truth + predicted - correct; }
};

class Confusion {
 public:
  explicit Confusion(std::span<const core::SceneClass> classes) {
    for (const core::SceneClass& c : classes) pixels_[c.id];
  }

  void add(std::span<const Overlap> overlaps) {
    for (const Overlap& cell : overlaps) {
      const auto truth = pixels_.find(cell.truth.class_id);
      if (truth == pixels_.end()) continue;
      truth->second.truth += cell.pixels;
      const auto predicted = pixels_.find(cell.predicted.class_id);
      if (predicted != pixels_.end()) predicted->second.predicted += cell.pixels;
      if (predicted == truth) truth->second.correct += cell.pixels;
      if (cell.predicted.class_id == 0) predicted_void_ += cell.pixels;
    }
  }

  [[nodiscard]] const ClassPixels& of(std::uint16_t class_id) const {
    return pixels_.at(class_id);
  }
  [[nodiscard]] bool predicts_void() const { return predicted_void_ > 0; }

 private:
  std::map<std::uint16_t, ClassPixels> pixels_;
  std::uint64_t predicted_void_ = 0;
};

double ratio(std::uint64_t part, std::uint64_t whole) {
  return static_cast<double>(part) / static_cast<double>(whole);
}

ClassSemantic pooled_class(const ClassPixels& pixels) {
  ClassSemantic result;
  result.has_iou = pixels.either() > 0;
  result.has_accuracy = pixels.truth > 0;
  if (result.has_iou) result.iou = ratio(pixels.correct, pixels.either());
  if (result.has_accuracy) result.accuracy = ratio(pixels.correct, pixels.truth);
  return result;
}

ClassSemantic averaged_class(std::span<const Confusion> frames, std::uint16_t class_id) {
  ClassSemantic result;
  int shown = 0;
  for (const Confusion& frame : frames) {
    const ClassPixels& pixels = frame.of(class_id);
    if (pixels.truth == 0) continue;
    result.iou += ratio(pixels.correct, pixels.either());
    result.accuracy += ratio(pixels.correct, pixels.truth);
    ++shown;
  }
  result.has_iou = result.has_accuracy = shown > 0;
  result.iou /= std::max(shown, 1);
  result.accuracy /= std::max(shown, 1);
  return result;
}

}  // namespace

SemanticQuality semantic_quality(const ContingencyTable& table,
                                 std::span<const core::SceneClass> classes,
                                 const SemanticRules& rules) {
  std::vector<Confusion> units(rules.per_frame ? table.frame_count() : 1, Confusion(classes));
  for (std::size_t i = 0; i < table.frame_count(); ++i) {
    units[rules.per_frame ? i : 0].add(table.frame(i));
  }

  SemanticQuality result;
  int with_iou = 0, with_accuracy = 0;
  for (const core::SceneClass& c : classes) {
    ClassSemantic entry =
        rules.per_frame ? averaged_class(units, c.id) : pooled_class(units.front().of(c.id));
    entry.class_id = c.id;
    if (rules.absent_class_is_zero) entry.has_iou = entry.has_accuracy = true;
    if (entry.has_iou) result.mean_iou += entry.iou, ++with_iou;
    if (entry.has_accuracy) result.mean_accuracy += entry.accuracy, ++with_accuracy;
    result.classes.push_back(entry);
  }
  if (rules.void_is_a_class && units.front().predicts_void()) ++with_iou;
  result.mean_iou /= std::max(with_iou, 1);
  result.mean_accuracy /= std::max(with_accuracy, 1);
  return result;
}

}  // namespace segsim::reconstruction
