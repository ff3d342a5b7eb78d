#include "nav/cost_map.h"

#include <algorithm>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/check.h"

namespace segsim::nav {
namespace {

constexpr float kFar_m = 1e6F;

constexpr int kBorder_cells = 12;  // Unknown cells kept around the observed part.

/// Inclusive range of cells.
struct Observed {
  Cell low{0}, high{0};
};

Observed observed_part(const OccupancyMap& map) {
  const int width = map.frame().width_cells, height = map.frame().height_cells;
  Cell low(width, height), high(-1, -1);
  for (int j = 0; j < height; ++j) {
    const float* row = map.body_log_odds().row(j);
    const auto seen = [](float odds) { return odds != 0.0F; };
    const float* first = std::find_if(row, row + width, seen);
    if (first == row + width) continue;
    int last = width - 1;
    while (!seen(row[last])) --last;
    low = {std::min(low.x, static_cast<int>(first - row)), std::min(low.y, j)};
    high = {std::max(high.x, last), j};
  }
  if (high.x < 0) return {{0, 0}, {width - 1, height - 1}};
  return {{std::max(low.x - kBorder_cells, 0), std::max(low.y - kBorder_cells, 0)},
          {std::min(high.x + kBorder_cells, width - 1),
           std::min(high.y + kBorder_cells, height - 1)}};
}

}  // namespace

core::Image<float> distance_to_cells_m(const core::Image<std::uint8_t>& sources,
                                       double resolution_m) {
  const int width = sources.width_px(), height = sources.height_px();
  core::Image<float> result(width, height, kFar_m);
  if (std::none_of(sources.pixels().begin(), sources.pixels().end(),
                   [](std::uint8_t value) { return value != 0; })) {
    return result;
  }
  cv::Mat not_source(height, width, CV_8U);
  for (int j = 0; j < height; ++j) {
    std::transform(
        sources.row(j), sources.row(j) + width, not_source.ptr<std::uint8_t>(j),
        [](std::uint8_t value) { return value != 0 ? std::uint8_t{0} : std::uint8_t{255}; });
  }
  cv::Mat distance(height, width, CV_32F, result.data());
  cv::distanceTransform(not_source, distance, cv::DIST_L2, cv::DIST_MASK_PRECISE, CV_32F);
  const auto scale = static_cast<float>(resolution_m);
  for (float& value : result.pixels()) value *= scale;
  return result;
}

void CostMap::build(const OccupancyMap& map, const CostMapOptions& options) {
  const Observed observed = observed_part(map);
  frame_ = map.frame();
  frame_.origin_m += glm::dvec2(observed.low) * frame_.resolution_m;
  frame_.width_cells = observed.high.x - observed.low.x + 1;
  frame_.height_cells = observed.high.y - observed.low.y + 1;
  options_ = options;
  states_.resize(frame_.width_cells, frame_.height_cells);
  core::Image<std::uint8_t> mast(frame_.width_cells, frame_.height_cells);
  const float occupied = map.options().occupied_above, free = map.options().free_below;
  for (int j = 0; j < frame_.height_cells; ++j) {
    const float* body_row = map.body_log_odds().row(j + observed.low.y) + observed.low.x;
    const float* mast_row = map.mast_log_odds().row(j + observed.low.y) + observed.low.x;
    for (int i = 0; i < frame_.width_cells; ++i) {
      states_(i, j) = body_row[i] > occupied ? CellState::kOccupied
                      : body_row[i] < free   ? CellState::kFree
                                             : CellState::kUnknown;
      mast(i, j) = mast_row[i] > occupied ? 1 : 0;
    }
  }
  finish(mast);
}

void CostMap::build(const GridFrame& frame, const core::Image<CellState>& body,
                    const core::Image<std::uint8_t>& mast, const CostMapOptions& options) {
  SEGSIM_CHECK(body.width_px() == frame.width_cells && body.height_px() == frame.height_cells,
               "states and frame differ in size");
  SEGSIM_CHECK(mast.empty() || mast.size() == body.size(), "mast and states differ in size");
  frame_ = frame;
  options_ = options;
  states_ = body;
  finish(mast.empty() ? core::Image<std::uint8_t>(frame.width_cells, frame.height_cells)
                      : mast);
}

void CostMap::finish(const core::Image<std::uint8_t>& mast) {
  const int width = frame_.width_cells, height = frame_.height_cells;
  core::Image<std::uint8_t> occupied(width, height);
  for (std::size_t k = 0; k < states_.size(); ++k) {
    occupied.data()[k] = states_.data()[k] == CellState::kOccupied ? 1 : 0;
  }
  clearance_m_ = distance_to_cells_m(occupied, frame_.resolution_m);
  mast_clearance_m_ = distance_to_cells_m(mast, frame_.resolution_m);

  traversable_.resize(width, height);
  clear_.resize(width, height);
  cost_.resize(width, height);
  const auto radius = static_cast<float>(options_.robot_radius_m + options_.margin_m);
  const auto mast_radius = static_cast<float>(options_.mast_radius_m);
  const float soft = std::max(static_cast<float>(options_.soft_distance_m), radius + 1e-3F);
  const auto weight = static_cast<float>(options_.soft_weight);
  for (std::size_t k = 0; k < states_.size(); ++k) {
    const float clearance = clearance_m_.data()[k];
    clear_.data()[k] =
        clearance >= radius && mast_clearance_m_.data()[k] >= mast_radius ? 1 : 0;
    const bool known_free = states_.data()[k] == CellState::kFree;
    traversable_.data()[k] =
        clear_.data()[k] != 0 && (known_free || options_.cross_unknown) ? 1 : 0;
    // Quadratic: cheap in the middle of a corridor, steep next to the wall.
    const float near = std::clamp((soft - clearance) / (soft - radius), 0.0F, 1.0F);
    cost_.data()[k] = 1.0F + weight * near * near;
    if (options_.cross_unknown && !known_free) {
      cost_.data()[k] *= static_cast<float>(options_.unknown_cost);
    }
  }
  if (!options_.cross_unknown) fill_pockets();
}

void CostMap::fill_pockets() {
  const int width = frame_.width_cells, height = frame_.height_cells;
  cv::Mat unknown(height, width, CV_8U);
  for (int j = 0; j < height; ++j) {
    for (int i = 0; i < width; ++i) {
      unknown.at<std::uint8_t>(j, i) =
          states_(i, j) == CellState::kUnknown && clear_(i, j) != 0 ? 1 : 0;
    }
  }
  cv::Mat labels, statistics, centroids;
  const int count =
      cv::connectedComponentsWithStats(unknown, labels, statistics, centroids, 8, CV_32S);
  std::vector<std::uint8_t> fill(static_cast<std::size_t>(count), 0);
  for (int label = 1; label < count; ++label) {
    const int* box = statistics.ptr<int>(label);
    // A pocket that touches the edge goes on beyond it.
    const bool inside = box[cv::CC_STAT_LEFT] > 0 && box[cv::CC_STAT_TOP] > 0 &&
                        box[cv::CC_STAT_LEFT] + box[cv::CC_STAT_WIDTH] < width &&
                        box[cv::CC_STAT_TOP] + box[cv::CC_STAT_HEIGHT] < height;
    const double area_m2 = box[cv::CC_STAT_AREA] * frame_.resolution_m * frame_.resolution_m;
    fill[static_cast<std::size_t>(label)] =
        inside && area_m2 < options_.fill_pocket_m2 ? 1 : 0;
  }
  for (int j = 0; j < height; ++j) {
    const int* label = labels.ptr<int>(j);
    for (int i = 0; i < width; ++i) {
      if (fill[static_cast<std::size_t>(label[i])] != 0) traversable_(i, j) = 1;
    }
  }
}

CellState CostMap::state(const Cell& cell) const {
  return frame_.contains(cell) ? states_(cell.x, cell.y) : CellState::kUnknown;
}
bool CostMap::traversable(const Cell& cell) const {
  return frame_.contains(cell) && traversable_(cell.x, cell.y) != 0;
}
bool CostMap::clear(const Cell& cell) const {
  return frame_.contains(cell) && clear_(cell.x, cell.y) != 0;
}
float CostMap::clearance_m(const Cell& cell) const {
  return frame_.contains(cell) ? clearance_m_(cell.x, cell.y) : kFar_m;
}
float CostMap::mast_clearance_m(const Cell& cell) const {
  return frame_.contains(cell) ? mast_clearance_m_(cell.x, cell.y) : kFar_m;
}
float CostMap::length_cost(const Cell& cell) const {
  return frame_.contains(cell) ? cost_(cell.x, cell.y) : 1.0F;
}

}  // namespace segsim::nav
