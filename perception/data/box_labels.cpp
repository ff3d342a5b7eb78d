#include "perception/data/box_labels.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>

namespace segsim::perception {
namespace {

struct PixelPosition {
  int x = 0, y = 0;
};

/// Bounds of pixels, half-open.
struct Bounds {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;

  [[nodiscard]] static Bounds of(const std::vector<PixelPosition>& pixels) {
    Bounds b{pixels[0].x, pixels[0].y, pixels[0].x + 1, pixels[0].y + 1};
    for (const PixelPosition& p : pixels) b.join({p.x, p.y, p.x + 1, p.y + 1});
    return b;
  }
  void join(const Bounds& other) {
    x0 = std::min(x0, other.x0);
    y0 = std::min(y0, other.y0);
    x1 = std::max(x1, other.x1);
    y1 = std::max(y1, other.y1);
  }
  /// Pixels between two bounds along the axis where they are farther apart; 0 if they touch.
  [[nodiscard]] int gap(const Bounds& other) const {
    return std::max({0, other.x0 - x1, x0 - other.x1, other.y0 - y1, y0 - other.y1});
  }
  [[nodiscard]] int longer_side() const { return std::max(x1 - x0, y1 - y0); }
};

/// 8-connected components of one instance, in the order of their first pixel (row by row).
std::vector<std::vector<PixelPosition>> components_of(const std::vector<PixelPosition>& pixels,
                                                      core::Image<std::uint8_t>& open) {
  for (const PixelPosition& p : pixels) open(p.x, p.y) = 1;
  std::vector<std::vector<PixelPosition>> components;
  std::vector<PixelPosition> stack;
  for (const PixelPosition& start : pixels) {
    if (open(start.x, start.y) == 0) continue;
    components.emplace_back();
    open(start.x, start.y) = 0;
    stack.push_back(start);
    while (!stack.empty()) {
      const PixelPosition p = stack.back();
      stack.pop_back();
      components.back().push_back(p);
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
          const int x = p.x + dx, y = p.y + dy;
          if (!open.contains(x, y) || open(x, y) == 0) continue;
          open(x, y) = 0;
          stack.push_back({x, y});
        }
      }
    }
  }
  return components;
}

/// The largest component and, again and again, those near what is kept: an object behind a
/// table's legs falls into pieces, but a floater of the same id lies apart.
std::vector<PixelPosition> keep_near(std::vector<std::vector<PixelPosition>> components,
                                     int image_width_px, double max_gap_share) {
  const auto largest =
      std::max_element(components.begin(), components.end(),
                       [](const auto& a, const auto& b) { return a.size() < b.size(); });
  Bounds kept_bounds = Bounds::of(*largest);
  const double max_gap =
      std::max(max_gap_share * kept_bounds.longer_side(), 0.02 * image_width_px);
  std::vector<PixelPosition> kept = std::move(*largest);
  components.erase(largest);
  for (bool grown = true; grown;) {
    grown = false;
    for (auto it = components.begin(); it != components.end();) {
      const Bounds bounds = Bounds::of(*it);
      if (kept_bounds.gap(bounds) > max_gap) {
        ++it;
        continue;
      }
      kept_bounds.join(bounds);
      kept.insert(kept.end(), it->begin(), it->end());
      it = components.erase(it);
      grown = true;
    }
  }
  return kept;
}

/// Box that cuts off floor(quantile * n) pixels at each side.
core::BoxPx quantile_box(const std::vector<PixelPosition>& pixels, double quantile) {
  std::vector<int> xs, ys;
  for (const PixelPosition& p : pixels) {
    xs.push_back(p.x);
    ys.push_back(p.y);
  }
  std::sort(xs.begin(), xs.end());
  std::sort(ys.begin(), ys.end());
  const auto cut = static_cast<std::size_t>(quantile * static_cast<double>(pixels.size()));
  const std::size_t last = pixels.size() - 1 - cut;
  return {static_cast<float>(xs[cut]), static_cast<float>(ys[cut]),
          static_cast<float>(xs[last] + 1), static_cast<float>(ys[last] + 1)};
}

std::vector<float> valid_depths(const core::Image<float>& depth_m,
                                const std::vector<PixelPosition>& pixels) {
  std::vector<float> depths_m;
  for (const PixelPosition& p : pixels) {
    if (std::isfinite(depth_m(p.x, p.y))) depths_m.push_back(depth_m(p.x, p.y));
  }
  return depths_m;
}

/// The lower of the two middle values of an even number.
float median_of(std::vector<float>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>((values.size() - 1) / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// The most frequent semantic id other than void, the lowest of equals; 0 if there is none.
std::uint16_t majority_class(const core::Image<std::uint16_t>& semantic,
                             const std::vector<PixelPosition>& pixels) {
  std::map<std::uint16_t, int> votes;
  for (const PixelPosition& p : pixels) {
    if (semantic(p.x, p.y) != 0) ++votes[semantic(p.x, p.y)];
  }
  std::uint16_t winner = 0;
  int most = 0;
  for (const auto& [id, count] : votes) {
    if (count > most) {
      most = count;
      winner = id;
    }
  }
  return winner;
}

std::optional<int> detector_class(std::uint16_t semantic_id,
                                  std::span<const core::SceneClass> scene_classes,
                                  std::span<const std::string> class_names) {
  for (const core::SceneClass& scene_class : scene_classes) {
    if (scene_class.id != semantic_id) continue;
    const auto name = std::find(class_names.begin(), class_names.end(), scene_class.name);
    if (name != class_names.end()) return static_cast<int>(name - class_names.begin());
  }
  return std::nullopt;
}

}  // namespace

std::vector<LabeledBox> label_boxes(const LabelView& view,
                                    std::span<const core::SceneClass> scene_classes,
                                    std::span<const std::string> class_names,
                                    const BoxLabelOptions& options) {
  SEGSIM_CHECK(view.semantic != nullptr && view.instance != nullptr,
               "label images are missing");
  const auto& instance = *view.instance;
  const int width = instance.width_px(), height = instance.height_px();
  SEGSIM_CHECK(view.semantic->width_px() == width && view.semantic->height_px() == height,
               "semantic image of another size");
  SEGSIM_CHECK(view.depth_m == nullptr ||
                   (view.depth_m->width_px() == width && view.depth_m->height_px() == height),
               "depth image of another size");
  SEGSIM_CHECK(options.quantile >= 0.0 && options.quantile < 0.5,
               std::to_string(options.quantile));

  std::map<std::uint16_t, std::vector<PixelPosition>> pixels_of;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (instance(x, y) != 0) pixels_of[instance(x, y)].push_back({x, y});
    }
  }

  std::vector<LabeledBox> labels;
  core::Image<std::uint8_t> scratch(width, height);
  const double min_pixels = options.min_visible_share * width * height;
  for (const auto& [id, pixels] : pixels_of) {
    const auto class_index =
        detector_class(majority_class(*view.semantic, pixels), scene_classes, class_names);
    if (!class_index) continue;
    const auto kept =
        keep_near(components_of(pixels, scratch), width, options.max_component_gap);
    LabeledBox label;
    label.class_index = *class_index;
    label.box = quantile_box(kept, options.quantile);
    label.area_px2 = static_cast<double>(kept.size());
    label.ignore = label.area_px2 < min_pixels;
    label.instance_id = id;
    const Bounds bounds = Bounds::of(kept);
    label.truncated =
        bounds.x0 == 0 || bounds.y0 == 0 || bounds.x1 == width || bounds.y1 == height;
    if (view.depth_m != nullptr) {
      std::vector<float> depths_m = valid_depths(*view.depth_m, kept);
      label.ignore |= static_cast<double>(depths_m.size()) <
                      options.min_valid_depth_share * label.area_px2;
      if (!depths_m.empty()) label.distance_m = double{median_of(depths_m)};
    }
    const std::optional<double> fraction =
        view.visible_fraction ? view.visible_fraction(id) : std::nullopt;
    if (fraction) {
      label.visible_fraction = std::clamp(*fraction, 0.0, 1.0);
      label.ignore |= *fraction < options.min_visible_fraction;
      label.occluded = *fraction < options.occluded_below;
    }
    labels.push_back(label);
  }
  return labels;
}

}  // namespace segsim::perception
