#include "renderer/raster/field_vote.h"

#include "renderer/raster/selection_key.h"

namespace segsim::renderer::internal {
namespace {

/// Of resolve_panoptic(), what comes after the sums.
PixelLabel label_of(const PanopticField& field, std::uint32_t agreed, float class_score,
                    float instance_score) {
  const std::uint32_t index = agreed & 0xFFFFU, instance = agreed >> 16U;
  PixelLabel label;
  label.semantic = field.class_id[index];
  label.confidence = class_score;
  if (instance == FieldTops::kNoThing) {
    label.instance_confidence = class_score;
    return label;
  }
  label.instance = field.instance_id[instance];
  label.instance_confidence = instance_score;
  if (field.instance_class.empty()) return label;
  if (field.instance_class[instance] != 0) label.semantic = field.instance_class[instance];
  if (label.instance == 0) label.semantic = 0;
  return label;
}

/// Sums in the order of resolve_panoptic().
struct Sums {
  double total = 0.0, class_score = 0.0, instance_score = 0.0, base = 0.0;
};

}  // namespace

FieldTops::FieldTops(const PanopticField& field) : field_(&field) {
  labels_.reserve(field.size());
  scores_.reserve(field.size());
  for (std::size_t i = 0; i < field.size(); ++i) {
    const auto classes = field.classes.row(i), instances = field.instances.row(i);
    std::uint32_t label = kUndecided;
    Scores scores{0.0F, 0.0F, field.instances.base(i), 0.0F};
    if (!classes.empty()) {
      scores.class_excess = classes[0].excess;
      const bool thing = field.class_is_thing[classes[0].index] != 0;
      // The largest index there could be stands for "no thing".
      const bool known = !thing || (!instances.empty() && instances[0].index < kNoThing);
      if (!instances.empty()) scores.instance_excess = instances[0].excess;
      if (known) {
        label = classes[0].index | (thing ? instances[0].index : kNoThing) << 16U;
      }
    }
    labels_.push_back(label);
    scores_.push_back(scores);
  }
}

std::uint64_t vote_field(const KeyRow& keys, const std::uint32_t* slots,
                         const SurfelShade* shade, const FieldTops& tops,
                         const LabelPlanes& out, PixelSet& left) {
  // Pixel by pixel: vectors would have to gather all they read.
  std::uint64_t read = 0;
  left = {};
  for (std::size_t pixel = 0; pixel < static_cast<std::size_t>(keys.pixel_count); ++pixel) {
    const std::uint32_t* key = keys.first + pixel;
    if (!is_key(*key)) {
      out.set(pixel, {});
      continue;
    }
    const std::uint32_t agreed = shade[slots[key_position(*key)]].label;
    bool decided = agreed != FieldTops::kUndecided;
    Sums sums;
    for (int k = 0; decided && k < keys.key_count && is_key(*key);
         ++k, key += keys.rank_stride) {
      const SurfelShade& surfel = shade[slots[key_position(*key)]];
      decided = surfel.label == agreed;
      const FieldTops::Scores& scores = tops.scores()[surfel.surfel];
      const auto weight = static_cast<double>(key_weight(*key));
      sums.total += weight;
      sums.class_score += weight * static_cast<double>(scores.class_excess);
      sums.instance_score += weight * static_cast<double>(scores.instance_excess);
      sums.base += weight * static_cast<double>(scores.instance_base);
      ++read;
    }
    if (!decided) {
      left[pixel / 64] |= std::uint64_t{1} << pixel % 64;
      continue;
    }
    out.set(pixel,
            label_of(tops.field(), agreed, static_cast<float>(sums.class_score / sums.total),
                     static_cast<float>((sums.base + sums.instance_score) / sums.total)));
  }
  return read;
}

}  // namespace segsim::renderer::internal
