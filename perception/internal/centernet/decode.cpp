#include "perception/internal/centernet/decode.h"

#include <algorithm>

#include "perception/internal/network/score.h"

namespace segsim::perception::centernet {
namespace {

/// One image, channels innermost.
struct Grid {
  const float* classes;
  std::int64_t height, width, class_count;

  [[nodiscard]] const float* at(std::int64_t y, std::int64_t x) const {
    return classes + (y * width + x) * class_count;
  }

  [[nodiscard]] bool is_peak(std::int64_t y, std::int64_t x, std::int64_t c) const {
    const float own = at(y, x)[c];
    for (std::int64_t v = std::max<std::int64_t>(0, y - 1); v <= std::min(height - 1, y + 1);
         ++v) {
      for (std::int64_t u = std::max<std::int64_t>(0, x - 1); u <= std::min(width - 1, x + 1);
           ++u) {
        if (at(v, u)[c] > own) return false;
      }
    }
    return true;
  }
};

core::BoxPx box_at(std::int64_t y, std::int64_t x, const float* sides_px) {
  const auto left = static_cast<float>(kStride_px * x),
             top = static_cast<float>(kStride_px * y);
  return {left - sides_px[0], top - sides_px[1], left + sides_px[2], top + sides_px[3]};
}

}  // namespace

std::vector<std::vector<core::Detection>> peaks_on_host(const HeatMaps& maps,
                                                        float score_threshold) {
  const auto classes = maps.classes.permute({0, 2, 3, 1}).contiguous();
  const auto sides = maps.sides_px.permute({0, 2, 3, 1}).contiguous();
  const std::int64_t images = classes.size(0);
  const float low = surely_low_logit(score_threshold);
  const float* next_sides = sides.data_ptr<float>();
  Grid grid{classes.data_ptr<float>(), classes.size(1), classes.size(2), classes.size(3)};
  std::vector<std::vector<core::Detection>> found(static_cast<std::size_t>(images));
  for (auto& image : found) {
    for (std::int64_t y = 0; y < grid.height; ++y) {
      for (std::int64_t x = 0; x < grid.width; ++x, next_sides += 4) {
        const float* logits = grid.at(y, x);
        for (std::int64_t c = 0; c < grid.class_count; ++c) {
          if (logits[c] < low) continue;
          const float score = score_of_logit(logits[c]);
          if (!(score >= score_threshold) || !grid.is_peak(y, x, c)) continue;
          image.push_back({static_cast<int>(c), score, box_at(y, x, next_sides)});
        }
      }
    }
    grid.classes += grid.height * grid.width * grid.class_count;
  }
  return found;
}

std::vector<std::vector<core::Detection>> peaks_on_device(const HeatMaps& maps,
                                                          float score_threshold) {
  std::vector<std::vector<core::Detection>> found(
      static_cast<std::size_t>(maps.classes.size(0)));
  const auto highest = torch::max_pool2d(maps.classes, 3, 1, 1);
  const auto scores = maps.classes.sigmoid().permute({0, 2, 3, 1});
  const auto peak = (maps.classes == highest).permute({0, 2, 3, 1});
  const auto hits = (peak & (scores >= score_threshold)).nonzero();  // image, y, x, class
  if (hits.size(0) == 0) return found;
  const auto column = hits.unbind(1);
  const auto sides =
      maps.sides_px.permute({0, 2, 3, 1}).index({column[0], column[1], column[2]});
  const auto hit_scores = scores.index({column[0], column[1], column[2], column[3]});
  // One copy for all: whole numbers are exact in float64.
  const auto rows =
      torch::cat({hits.to(torch::kFloat64), hit_scores.unsqueeze(1).to(torch::kFloat64),
                  sides.to(torch::kFloat64)},
                 1)
          .to(torch::kCPU)
          .contiguous();
  const double* row = rows.data_ptr<double>();
  for (std::int64_t i = 0; i < rows.size(0); ++i, row += rows.size(1)) {
    const float sides_px[] = {static_cast<float>(row[5]), static_cast<float>(row[6]),
                              static_cast<float>(row[7]), static_cast<float>(row[8])};
    found[static_cast<std::size_t>(row[0])].push_back(
        {static_cast<int>(row[3]), static_cast<float>(row[4]),
         box_at(static_cast<std::int64_t>(row[1]), static_cast<std::int64_t>(row[2]),
                sides_px)});
  }
  return found;
}

}  // namespace segsim::perception::centernet
