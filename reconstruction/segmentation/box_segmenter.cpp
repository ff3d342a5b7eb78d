#include "reconstruction/segmentation/box_segmenter.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/check.h"

namespace segsim::reconstruction {
namespace {

constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();
constexpr std::uint64_t kGrabCutSeed = 0x5e651;  ///< Its colour models begin with k-means.

bool known(float depth_m) { return depth_m > 0.0F && std::isfinite(depth_m); }

/// Pixels [x0, x1) x [y0, y1).
struct Window {
  int x0, y0, x1, y1;

  [[nodiscard]] bool empty() const { return x1 <= x0 || y1 <= y0; }
  [[nodiscard]] int width() const { return x1 - x0; }
  [[nodiscard]] int height() const { return y1 - y0; }
};

/// @param grow  Share of the sides by which the box is enlarged.
Window window_of(const core::BoxPx& box, double grow, int width_px, int height_px) {
  const double dx = grow * box.width_px(), dy = grow * box.height_px();
  const auto to = [](double v, int most) {
    return static_cast<int>(std::clamp(std::round(v), 0.0, static_cast<double>(most)));
  };
  return {to(box.x0 - dx, width_px), to(box.y0 - dy, height_px), to(box.x1 + dx, width_px),
          to(box.y1 + dy, height_px)};
}

/// Unknown depth between two known ones, at most `reach` pixels apart along a row or column,
/// takes the nearer one's; of equals that to the left or above.
core::Image<float> bridged(const core::Image<float>& depth_m, int reach) {
  core::Image<float> filled = depth_m;
  const auto look = [&](int x, int y, int dx, int dy) -> std::pair<float, int> {
    for (int k = 1; k <= reach; ++k) {
      if (!depth_m.contains(x + k * dx, y + k * dy)) break;
      const float d_m = depth_m(x + k * dx, y + k * dy);
      if (known(d_m)) return {d_m, k};
    }
    return {kUnknown, reach + 1};
  };
  for (int y = 0; y < depth_m.height_px(); ++y) {
    for (int x = 0; x < depth_m.width_px(); ++x) {
      if (known(depth_m(x, y))) continue;
      filled(x, y) = kUnknown;
      const auto left = look(x, y, -1, 0), right = look(x, y, 1, 0);
      const auto above = look(x, y, 0, -1), below = look(x, y, 0, 1);
      const bool across = known(left.first) && known(right.first);
      const bool along = known(above.first) && known(below.first);
      if (across && left.second + right.second <= reach + 1) {
        filled(x, y) = left.second <= right.second ? left.first : right.first;
      } else if (along && above.second + below.second <= reach + 1) {
        filled(x, y) = above.second <= below.second ? above.first : below.first;
      }
    }
  }
  return filled;
}

/// What the pixels of a box say about one region.
struct RegionInBox {
  std::int64_t px = 0;
  double weight = 0.0;  ///< Sum over its pixels of 1 in the middle, 0 at the sides.
  double share = 0.0;   ///< Of the region's pixels.
  std::vector<float> depths_m;

  [[nodiscard]] float quantile_m(double q) {
    const auto at = static_cast<std::ptrdiff_t>(q * static_cast<double>(depths_m.size() - 1));
    std::nth_element(depths_m.begin(), depths_m.begin() + at, depths_m.end());
    return depths_m[static_cast<std::size_t>(at)];
  }
};

enum class Role : std::uint8_t { kObject, kLikely, kUnlikely, kForeign };

/// Small islands beside the largest piece are dropped.
void keep_large_pieces(cv::Mat& mask) {
  constexpr double kLeast = 0.1;
  cv::Mat labels, stats, centres;
  const int count = cv::connectedComponentsWithStats(mask, labels, stats, centres, 8, CV_32S);
  int largest = 0;
  for (int k = 1; k < count; ++k)
    largest = std::max(largest, stats.at<int>(k, cv::CC_STAT_AREA));
  for (int y = 0; y < mask.rows; ++y) {
    for (int x = 0; x < mask.cols; ++x) {
      const int k = labels.at<int>(y, x);
      if (k > 0 && stats.at<int>(k, cv::CC_STAT_AREA) < kLeast * largest) {
        mask.at<std::uint8_t>(y, x) = 0;
      }
    }
  }
}

}  // namespace

BoxSegmenter::BoxSegmenter(const core::Image<core::Rgb8>& rgb,
                           const core::Image<float>& depth_m,
                           const core::Image<RoomPart>& parts, double focal_px,
                           const BoxSegmenterOptions& options)
    : rgb_(rgb),
      depth_m_(depth_m.empty() ? core::Image<float>(rgb.width_px(), rgb.height_px(), kUnknown)
                               : bridged(depth_m, options.bridge_px)),
      parts_(parts.empty()
                 ? core::Image<RoomPart>(rgb.width_px(), rgb.height_px(), RoomPart::kNone)
                 : parts),
      focal_px_(focal_px),
      options_(options),
      region_(rgb.width_px(), rgb.height_px()),
      region_px_(1, 0) {
  SEGSIM_CHECK(
      depth_m_.width_px() == rgb.width_px() && depth_m_.height_px() == rgb.height_px() &&
          parts_.width_px() == rgb.width_px() && parts_.height_px() == rgb.height_px(),
      "images of equal size");
  SEGSIM_CHECK(focal_px > 0.0, std::to_string(focal_px));
  const auto free = [&](int x, int y) {
    return known(depth_m_(x, y)) && parts_(x, y) == RoomPart::kNone;
  };
  std::vector<std::pair<int, int>> stack;
  for (int y0 = 0; y0 < rgb.height_px(); ++y0) {
    for (int x0 = 0; x0 < rgb.width_px(); ++x0) {
      if (region_(x0, y0) != 0 || !free(x0, y0)) continue;
      const auto id = static_cast<std::int32_t>(region_px_.size());
      region_px_.push_back(0);
      region_(x0, y0) = id;
      stack.assign(1, {x0, y0});
      while (!stack.empty()) {
        const auto [x, y] = stack.back();
        stack.pop_back();
        ++region_px_.back();
        constexpr int kSteps[4][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}};
        for (const auto& step : kSteps) {
          const int nx = x + step[0], ny = y + step[1];
          if (!region_.contains(nx, ny) || region_(nx, ny) != 0 || !free(nx, ny)) continue;
          const double a_m = depth_m_(x, y), b_m = depth_m_(nx, ny);
          if (std::abs(a_m - b_m) > options_.depth_step * std::min(a_m, b_m)) continue;
          region_(nx, ny) = id;
          stack.emplace_back(nx, ny);
        }
      }
    }
  }
}

core::Image<std::uint8_t> BoxSegmenter::segment(const core::BoxPx& box) const {
  core::Image<std::uint8_t> mask(rgb_.width_px(), rgb_.height_px());
  const Window inner = window_of(box, 0.0, rgb_.width_px(), rgb_.height_px());
  const Window may = window_of(box, options_.grow, rgb_.width_px(), rgb_.height_px());
  // Colours of the surroundings, for GrabCut to learn.
  const Window crop = window_of(box, 0.25 + options_.grow, rgb_.width_px(), rgb_.height_px());
  constexpr int kFewest_px = 4;
  if (inner.width() < kFewest_px || inner.height() < kFewest_px) return mask;

  // How far out a pixel lies: 0 in the middle of the box, 1 at its sides.
  const double mid_x = 0.5 * (box.x0 + box.x1), mid_y = 0.5 * (box.y0 + box.y1);
  const auto out_x = [&](int x) { return std::abs(x + 0.5 - mid_x) / (0.5 * box.width_px()); };
  const auto out_y = [&](int y) {
    return std::abs(y + 0.5 - mid_y) / (0.5 * box.height_px());
  };

  // A picture on a wall is a part of the wall by its shape: where there is nothing else, the
  // room's parts are no obstacle.
  constexpr double kOnWall = 0.85;
  std::int64_t on_room = 0, with_depth = 0;
  std::map<std::int32_t, RegionInBox> regions;
  for (int y = may.y0; y < may.y1; ++y) {
    for (int x = may.x0; x < may.x1; ++x) {
      if (!known(depth_m_(x, y))) continue;
      ++with_depth;
      on_room += parts_(x, y) != RoomPart::kNone ? 1 : 0;
      if (region_(x, y) == 0) continue;
      RegionInBox& region = regions[region_(x, y)];
      ++region.px;
      region.weight += std::max(0.0, 1.0 - out_x(x)) * std::max(0.0, 1.0 - out_y(y));
      region.depths_m.push_back(depth_m_(x, y));
    }
  }
  const bool flat = static_cast<double>(on_room) > kOnWall * static_cast<double>(with_depth);

  std::int32_t anchor = 0;
  double best = 0.0;
  for (auto& [id, region] : regions) {
    region.share = static_cast<double>(region.px) /
                   static_cast<double>(region_px_[static_cast<std::size_t>(id)]);
    if (region.weight * region.share > best) anchor = id, best = region.weight * region.share;
  }
  std::map<std::int32_t, Role> roles;
  if (anchor != 0) {
    RegionInBox& object = regions[anchor];
    const double near_m = object.quantile_m(0.05), far_m = object.quantile_m(0.95);
    const double diagonal_m =
        std::hypot(box.width_px(), box.height_px()) / focal_px_ * 0.5 * (near_m + far_m);
    const double margin_m = options_.depth_margin * diagonal_m;
    for (auto& [id, region] : regions) {
      const double middle_m = region.quantile_m(0.5);
      const bool at_depth = middle_m > near_m - margin_m && middle_m < far_m + margin_m;
      if (id == anchor) {
        roles[id] = region.share >= options_.inside_share ? Role::kObject : Role::kLikely;
      } else if (!at_depth || region.share < options_.foreign_share) {
        roles[id] = Role::kForeign;
      } else {
        roles[id] = region.share >= options_.inside_share ? Role::kLikely : Role::kUnlikely;
      }
    }
  }

  cv::Mat colours(crop.height(), crop.width(), CV_8UC3),
      seeds(crop.height(), crop.width(), CV_8UC1);
  for (int y = crop.y0; y < crop.y1; ++y) {
    for (int x = crop.x0; x < crop.x1; ++x) {
      const core::Rgb8& c = rgb_(x, y);
      colours.at<cv::Vec3b>(y - crop.y0, x - crop.x0) = {c.b, c.g, c.r};
      const bool in_middle = std::hypot(out_x(x), out_y(y)) < 0.8;
      std::uint8_t seed = in_middle ? cv::GC_PR_FGD : cv::GC_PR_BGD;
      if (x < may.x0 || x >= may.x1 || y < may.y0 || y >= may.y1) {
        seed = cv::GC_BGD;
      } else if (parts_(x, y) != RoomPart::kNone) {
        if (!flat) seed = cv::GC_BGD;
      } else if (region_(x, y) != 0) {
        switch (roles[region_(x, y)]) {
          case Role::kObject:
            seed = cv::GC_FGD;
            break;
          case Role::kLikely:
            seed = cv::GC_PR_FGD;
            break;
          case Role::kUnlikely:
            seed = cv::GC_PR_BGD;
            break;
          case Role::kForeign:
            seed = cv::GC_BGD;
            break;
        }
      }
      seeds.at<std::uint8_t>(y - crop.y0, x - crop.x0) = seed;
    }
  }
  // At depth steps the colour camera and the depth camera disagree by a pixel or two.
  cv::Mat certain = seeds == cv::GC_FGD, core_of_it;
  cv::erode(certain, core_of_it, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}));
  seeds.setTo(cv::GC_PR_FGD, certain & ~core_of_it);

  const double scale = std::min(
      1.0, static_cast<double>(options_.longest_px) / std::max(crop.width(), crop.height()));
  cv::Mat small_colours = colours, small_seeds = seeds;
  if (scale < 1.0) {
    cv::resize(colours, small_colours, {}, scale, scale, cv::INTER_AREA);
    cv::resize(seeds, small_seeds, small_colours.size(), 0, 0, cv::INTER_NEAREST);
  }
  const cv::Mat object_before = (small_seeds == cv::GC_FGD) | (small_seeds == cv::GC_PR_FGD);
  const int object_px = cv::countNonZero(object_before);
  constexpr int kFewestColours = 8;
  const int all_px = small_seeds.rows * small_seeds.cols;
  if (object_px < kFewestColours) return mask;
  const bool undecided =
      cv::countNonZero((small_seeds == cv::GC_PR_FGD) | (small_seeds == cv::GC_PR_BGD)) > 0;
  if (undecided && all_px - object_px >= kFewestColours) {
    cv::theRNG().state = kGrabCutSeed;
    cv::Mat model_of_rest, model_of_object;
    cv::grabCut(small_colours, small_seeds, {}, model_of_rest, model_of_object,
                options_.rounds, cv::GC_INIT_WITH_MASK);
  }
  cv::Mat decided = (small_seeds == cv::GC_FGD) | (small_seeds == cv::GC_PR_FGD);
  if (scale < 1.0) cv::resize(decided, decided, colours.size(), 0, 0, cv::INTER_NEAREST);
  // What was certain at full size stays so.
  decided.setTo(0, seeds == cv::GC_BGD);
  decided.setTo(255, seeds == cv::GC_FGD);
  keep_large_pieces(decided);
  const double box_px = static_cast<double>(inner.width()) * inner.height();
  if (cv::countNonZero(decided) < options_.least_fill * box_px) return mask;
  for (int y = 0; y < decided.rows; ++y) {
    for (int x = 0; x < decided.cols; ++x) {
      mask(crop.x0 + x, crop.y0 + y) = decided.at<std::uint8_t>(y, x) != 0 ? 1 : 0;
    }
  }
  return mask;
}

}  // namespace segsim::reconstruction
