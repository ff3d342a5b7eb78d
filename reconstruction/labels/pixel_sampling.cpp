#include "reconstruction/labels/pixel_sampling.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "core/check.h"

namespace segsim::reconstruction {
namespace {

/// Lists of an image's pixels to draw from.
struct Candidates {
  std::vector<std::int32_t> all, stuff, things;
  std::map<std::uint16_t, std::vector<std::int32_t>> masks;  ///< Of things, by id.
};

Candidates candidates_of(const core::FrameMasks& masks, const core::Image<float>& depth_m,
                         std::span<const core::SceneClass> classes, double min_depth_m) {
  std::vector<bool> is_thing(65536, false);
  for (const core::SceneClass& c : classes) is_thing[c.id] = c.thing;
  Candidates from;
  for (std::size_t i = 0; i < masks.semantic.size(); ++i) {
    if (!depth_m.empty() && !(static_cast<double>(depth_m.data()[i]) > min_depth_m)) continue;
    const std::uint16_t id = masks.semantic.data()[i];
    const auto pixel = static_cast<std::int32_t>(i);
    from.all.push_back(pixel);
    if (id != 0 && !is_thing[id]) from.stuff.push_back(pixel);
    const std::uint16_t instance = masks.instance.data()[i];
    if (id == 0 || !is_thing[id] || instance == 0) continue;
    from.things.push_back(pixel);
    from.masks[instance].push_back(pixel);
  }
  return from;
}

/// Draws, and remembers how often each pixel could expect to be drawn.
class Drawing {
 public:
  Drawing(std::size_t image_pixels, core::RandomStream& random)
      : random_(random), expected_(image_pixels, 0.0F) {}

  /// A random subset; shuffles `from`.
  void draw(std::vector<std::int32_t>& from, std::size_t count) {
    if (from.empty()) return;
    count = std::min(count, from.size());
    const float rate = static_cast<float>(count) / static_cast<float>(from.size());
    for (const std::int32_t pixel : from) expected_[static_cast<std::size_t>(pixel)] += rate;
    for (std::size_t i = 0; i < count; ++i) {
      std::swap(from[i], from[i + random_.index(static_cast<std::uint32_t>(from.size() - i))]);
      sample_.pixels.push_back(from[i]);
    }
  }

  [[nodiscard]] std::size_t count() const { return sample_.pixels.size(); }

  [[nodiscard]] PixelSample sample() && {
    std::sort(sample_.pixels.begin(), sample_.pixels.end());
    double sum = 0.0;
    for (const std::int32_t pixel : sample_.pixels) {
      sample_.importance.push_back(1.0F / expected_[static_cast<std::size_t>(pixel)]);
      sum += static_cast<double>(sample_.importance.back());
    }
    const auto scale = static_cast<float>(static_cast<double>(count()) / sum);
    for (float& weight : sample_.importance) weight *= scale;
    return std::move(sample_);
  }

 private:
  core::RandomStream& random_;
  std::vector<float> expected_;
  PixelSample sample_;
};

}  // namespace

PixelSample sample_pixels(const core::FrameMasks& masks, const core::Image<float>& depth_m,
                          std::span<const core::SceneClass> classes,
                          const PixelSamplingConfig& config, core::RandomStream& random) {
  const std::size_t count = masks.semantic.size();
  SEGSIM_CHECK(masks.instance.size() == count, "masks of one size");
  SEGSIM_CHECK(depth_m.empty() || depth_m.size() == count, "depth and masks of one size");
  Candidates from = candidates_of(masks, depth_m, classes, config.min_depth_m);
  const auto share = [&](double part) {
    return static_cast<std::size_t>(std::llround(part * config.pixels));
  };
  Drawing drawing(count, random);
  drawing.draw(from.stuff, share(config.stuff_share));
  const double even = config.instance_share * config.even_share;
  drawing.draw(from.things, share(config.instance_share - even));
  for (auto& [id, pixels] : from.masks) drawing.draw(pixels, share(even) / from.masks.size());
  const auto wanted = static_cast<std::size_t>(config.pixels);
  drawing.draw(from.all, wanted - std::min(wanted, drawing.count()));
  return std::move(drawing).sample();
}

}  // namespace segsim::reconstruction
