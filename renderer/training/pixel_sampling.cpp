#include "renderer/training/pixel_sampling.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "core/check.h"

namespace segsim::renderer {
namespace {

/// Appends a random subset; shuffles `from`.
void draw(std::vector<std::int32_t>& from, std::size_t count, core::RandomStream& random,
          std::vector<std::int32_t>& to) {
  count = std::min(count, from.size());
  for (std::size_t i = 0; i < count; ++i) {
    std::swap(from[i], from[i + random.index(static_cast<std::uint32_t>(from.size() - i))]);
    to.push_back(from[i]);
  }
}

/// Appends about `count` pixels, as many of each mask; small masks give all they have.
void draw_evenly(std::map<std::uint16_t, std::vector<std::int32_t>>& masks, std::size_t count,
                 core::RandomStream& random, std::vector<std::int32_t>& to) {
  if (masks.empty()) return;
  for (auto& [id, pixels] : masks) draw(pixels, count / masks.size(), random, to);
}

}  // namespace

std::vector<std::int32_t> sample_pixels(const core::FrameMasks& masks,
                                        const core::Image<float>& depth_m,
                                        std::span<const core::SceneClass> classes,
                                        const PixelSamplingConfig& config,
                                        core::RandomStream& random) {
  const std::size_t count = masks.semantic.size();
  SEGSIM_CHECK(masks.instance.size() == count, "masks of one size");
  SEGSIM_CHECK(depth_m.empty() || depth_m.size() == count, "depth and masks of one size");
  std::vector<bool> is_thing(65536, false);
  for (const core::SceneClass& c : classes) is_thing[c.id] = c.thing;

  std::vector<std::int32_t> all, stuff, things;
  std::map<std::uint16_t, std::vector<std::int32_t>> masks_of_things;
  for (std::size_t i = 0; i < count; ++i) {
    if (!depth_m.empty() && !(static_cast<double>(depth_m.data()[i]) > config.min_depth_m)) {
      continue;
    }
    const std::uint16_t id = masks.semantic.data()[i];
    const auto pixel = static_cast<std::int32_t>(i);
    all.push_back(pixel);
    if (id != 0 && !is_thing[id]) stuff.push_back(pixel);
    const std::uint16_t instance = masks.instance.data()[i];
    if (id == 0 || !is_thing[id] || instance == 0) continue;
    things.push_back(pixel);
    masks_of_things[instance].push_back(pixel);
  }
  const auto share = [&](double part) {
    return static_cast<std::size_t>(std::llround(part * config.pixels));
  };
  std::vector<std::int32_t> pixels;
  draw(stuff, share(config.stuff_share), random, pixels);
  const double even = config.instance_share * config.even_share;
  draw(things, share(config.instance_share - even), random, pixels);
  draw_evenly(masks_of_things, share(even), random, pixels);
  draw(all, static_cast<std::size_t>(config.pixels) - pixels.size(), random, pixels);
  std::sort(pixels.begin(), pixels.end());
  return pixels;
}

}  // namespace segsim::renderer
