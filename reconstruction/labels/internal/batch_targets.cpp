#include "reconstruction/labels/internal/batch_targets.h"

#include <algorithm>
#include <map>
#include <string>

#include "core/error.h"

namespace segsim::reconstruction::internal {
namespace {

std::vector<std::int64_t> indices_by_id(const std::vector<core::SceneClass>& classes) {
  std::vector<std::int64_t> index(65536, -1);
  for (std::size_t c = 0; c < classes.size(); ++c) {
    index[classes[c].id] = static_cast<std::int64_t>(c);
  }
  return index;
}

std::int64_t class_of(const std::vector<std::int64_t>& index, const PanopticBatch& batch,
                      std::int64_t pixel) {
  const std::uint16_t id = batch.semantic[pixel];
  if (id != 0 && index[id] < 0) {
    throw core::InputError::expected("masks of frame " + std::to_string(batch.frame),
                                     "classes of the table", std::to_string(id));
  }
  return index[id];
}

/// Votes of a mask's pixels for classes.
struct Votes {
  std::vector<std::int64_t> pixels;  ///< By class.
  std::int64_t total = 0;
};

std::vector<TargetMask> masks_of(const std::map<std::uint16_t, Votes>& votes,
                                 int min_mask_pixels) {
  std::vector<TargetMask> masks;
  for (const auto& [id, vote] : votes) {
    if (vote.total < min_mask_pixels) continue;
    const auto best = std::max_element(vote.pixels.begin(), vote.pixels.end());
    masks.push_back({id, static_cast<int>(best - vote.pixels.begin()), vote.total});
  }
  return masks;
}

}  // namespace

BatchTargets make_targets(const PanopticBatch& batch, const float* alpha,
                          const std::vector<core::SceneClass>& classes,
                          const PanopticTrainingConfig& config) {
  const std::vector<std::int64_t> index = indices_by_id(classes);
  const auto count = static_cast<std::size_t>(batch.weights.pixels);
  BatchTargets targets;
  targets.class_index.assign(count, -1);
  targets.mask_index.assign(count, -1);
  targets.importance.assign(count, 1.0F);
  if (batch.importance != nullptr) {
    targets.importance.assign(batch.importance, batch.importance + count);
  }
  targets.weight = targets.importance;
  std::map<std::uint16_t, Votes> votes;
  for (std::size_t p = 0; p < count; ++p) {
    const auto pixel = static_cast<std::int64_t>(p);
    const std::int64_t c = class_of(index, batch, pixel);
    if (static_cast<double>(alpha[p]) < config.sampling.min_alpha) continue;
    targets.valid.push_back(pixel);
    if (c < 0) continue;
    targets.class_index[p] = c;
    targets.labelled.push_back(pixel);
    if (config.use_confidence && batch.confidence != nullptr) {
      targets.weight[p] *= batch.confidence[p];
    }
    if (batch.instance[p] == 0 || !classes[static_cast<std::size_t>(c)].thing) continue;
    Votes& vote = votes[batch.instance[p]];
    vote.pixels.resize(classes.size(), 0);
    ++vote.pixels[static_cast<std::size_t>(c)];
    ++vote.total;
  }
  targets.masks = masks_of(votes, config.query.min_mask_pixels);
  std::map<std::uint16_t, std::int64_t> index_of_mask;
  for (const TargetMask& mask : targets.masks) {
    index_of_mask.emplace(mask.id, static_cast<std::int64_t>(index_of_mask.size()));
  }
  for (const std::int64_t pixel : targets.labelled) {
    const auto p = static_cast<std::size_t>(pixel);
    const auto found = index_of_mask.find(batch.instance[p]);
    const bool thing = classes[static_cast<std::size_t>(targets.class_index[p])].thing;
    if (thing && found != index_of_mask.end()) targets.mask_index[p] = found->second;
  }
  return targets;
}

}  // namespace segsim::reconstruction::internal
