#include "reconstruction/labels/internal/regions.h"

#include <map>

namespace segsim::reconstruction::internal {

Tensor Regions::means(const Tensor& values) const {
  return torch::zeros({count(), values.size(1)}, values.options())
             .index_add(0, region, values) /
         size;
}

Regions regions_of(const BatchTargets& targets, const std::vector<core::SceneClass>& classes,
                   int min_pixels, const at::Device& device) {
  std::map<std::int64_t, std::vector<std::int64_t>> by_key;
  for (const std::int64_t pixel : targets.labelled) {
    const auto p = static_cast<std::size_t>(pixel);
    const std::int64_t mask = targets.mask_index[p], c = targets.class_index[p];
    if (mask < 0 && classes[static_cast<std::size_t>(c)].thing) continue;
    by_key[mask < 0 ? -1 - c : targets.masks[static_cast<std::size_t>(mask)].id].push_back(
        pixel);
  }
  Regions regions;
  std::vector<std::int64_t> pixel, region;
  std::vector<float> size;
  for (auto& [key, pixels] : by_key) {
    if (pixels.size() < static_cast<std::size_t>(min_pixels)) continue;
    pixel.insert(pixel.end(), pixels.begin(), pixels.end());
    region.insert(region.end(), pixels.size(), regions.count());
    size.push_back(static_cast<float>(pixels.size()));
    regions.key.push_back(key);
    regions.pixels.push_back(std::move(pixels));
  }
  regions.pixel = device_tensor(pixel, torch::kInt64, device);
  regions.region = device_tensor(region, torch::kInt64, device);
  regions.size = device_tensor(size, torch::kFloat32, device).unsqueeze(1);
  return regions;
}

}  // namespace segsim::reconstruction::internal
