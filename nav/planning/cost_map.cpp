#include "nav/planning/cost_map.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/check.h"

namespace segsim::nav {
namespace {

constexpr float kFar_m = 1e6F;

constexpr int kBorder_cells = 12;  // Unknown cells kept around the observed part.
constexpr int kRoom_cells = 60;    // What a frame that has to grow gets beyond that.

/// The up to four boxes that `outer` has around `inner`.
void add_frame_of(const CellBox& outer, const CellBox& inner, std::vector<CellBox>& boxes) {
  const CellBox around[] = {{outer.low, {outer.high.x, inner.low.y - 1}},
                            {{outer.low.x, inner.high.y + 1}, outer.high},
                            {{outer.low.x, inner.low.y}, {inner.low.x - 1, inner.high.y}},
                            {{inner.high.x + 1, inner.low.y}, {outer.high.x, inner.high.y}}};
  for (const CellBox& box : around) {
    if (!box.empty()) boxes.push_back(box);
  }
}

template <class Pixel>
std::span<const Pixel> part_of_row(const GridView<Pixel>& cells, int j, int i0, int count) {
  return {cells.row(j) + i0, static_cast<std::size_t>(count)};
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
  start(map.frame(), options);
  update(map, map.frame().box(), options);
}

void CostMap::build(const GridFrame& frame, const GridView<CellState>& body,
                    const GridView<std::uint8_t>& mast, const CostMapOptions& options) {
  SEGSIM_CHECK(
      body.width_cells() == frame.width_cells && body.height_cells() == frame.height_cells,
      "states and frame differ in size");
  SEGSIM_CHECK(mast.empty() || same_size(mast, body), "mast and states differ in size");
  start(frame, options);
  set_active(frame.box());
  const std::vector<std::uint8_t> none(static_cast<std::size_t>(frame.width_cells), 0);
  for (int j = 0; j < frame.height_cells; ++j) {
    take_row(j, 0, part_of_row(body, j, 0, frame.width_cells),
             mast.empty() ? none : part_of_row(mast, j, 0, frame.width_cells));
  }
  finish();
}

void CostMap::update(const OccupancyMap& map, const CellBox& changed,
                     const CostMapOptions& options) {
  const CellBox box = follow(map.frame(), changed, options);
  set_active(map.observed().empty()
                 ? frame_.box()
                 : map.observed().grown(kBorder_cells).clipped_to(frame_.box()));
  const float occupied = map.options().occupied_above, free = map.options().free_below;
  const int count = box.empty() ? 0 : box.width();
  std::vector<CellState> states(static_cast<std::size_t>(count));
  std::vector<std::uint8_t> mast(static_cast<std::size_t>(count));
  for (int j = box.low.y; j <= box.high.y && count > 0; ++j) {
    const float* body_row = map.body_log_odds().row(j) + box.low.x;
    const float* mast_row = map.mast_log_odds().row(j) + box.low.x;
    for (std::size_t i = 0; i < states.size(); ++i) {
      states[i] = body_row[i] > occupied ? CellState::kOccupied
                  : body_row[i] < free   ? CellState::kFree
                                         : CellState::kUnknown;
      mast[i] = mast_row[i] > occupied ? 1 : 0;
    }
    take_row(j, box.low.x, states, mast);
  }
  finish();
}

void CostMap::update(const GridFrame& frame, const GridView<std::uint8_t>& occupied,
                     const GridView<std::uint8_t>& explored,
                     const GridView<std::uint8_t>& mast, const CellBox& active,
                     const CellBox& changed, const CostMapOptions& options) {
  SEGSIM_CHECK(same_size(occupied, explored) && frame.width_cells == occupied.width_cells(),
               "layers and frame differ in size");
  // Of a large frame only the active part is kept, with some room to grow.
  const CellBox wanted = active.grown(kBorder_cells).clipped_to(frame.box());
  CellBox kept = wanted.grown(kRoom_cells).clipped_to(frame.box());
  if (frame_.width_cells > 0) {
    const Cell shift = frame_.lattice() - frame.lattice();
    const CellBox now{shift + frame_.box().low, shift + frame_.box().high};
    if (wanted.clipped_to(now) == wanted) {
      kept = now;
    } else {
      kept.add(now);
    }
  }
  GridFrame part = frame;
  part.origin_m += glm::dvec2(kept.low) * frame.resolution_m;
  part.width_cells = kept.width();
  part.height_cells = kept.height();
  const auto inside = [&](const CellBox& box) {
    return CellBox{box.low - kept.low, box.high - kept.low}.clipped_to(part.box());
  };
  const CellBox box = follow(part, changed.empty() ? changed : inside(changed), options);
  set_active(inside(wanted));
  const int count = box.empty() ? 0 : box.width();
  std::vector<CellState> states(static_cast<std::size_t>(count));
  const std::vector<std::uint8_t> none(static_cast<std::size_t>(count), 0);
  for (int j = box.low.y; j <= box.high.y && count > 0; ++j) {
    const Cell from = kept.low + Cell(box.low.x, j);
    const std::uint8_t* hit = occupied.row(from.y) + from.x;
    const std::uint8_t* seen = explored.row(from.y) + from.x;
    for (std::size_t i = 0; i < states.size(); ++i) {
      states[i] = hit[i] != 0    ? CellState::kOccupied
                  : seen[i] != 0 ? CellState::kFree
                                 : CellState::kUnknown;
    }
    take_row(j, box.low.x, states,
             mast.empty() ? none : part_of_row(mast, from.y, from.x, count));
  }
  finish();
}

// ---- What is known

void CostMap::start(const GridFrame& frame, const CostMapOptions& options) {
  frame_ = frame;
  options_ = options;
  active_ = changed_ = body_changed_ = mast_changed_ = {};
  added_.clear();
  dirty_.clear();
  const int width = frame.width_cells, height = frame.height_cells;
  states_.reset(width, height);  // Unknown.
  for (auto* layer : {&occupied_, &mast_, &traversable_, &clear_, &pocket_}) {
    layer->reset(width, height);
  }
  visited_ = {};
  visit_ = 0;
  make_tables();
  const auto last = static_cast<double>(clearance_table_m_.size() - 2);
  const int reach_cells = static_cast<int>(std::lround(std::sqrt(last)));
  body_field_.reset(width, height, reach_cells);
  mast_field_.reset(width, height, reach_cells);
  cost_.reset(width, height, 1.0F);
}

CellBox CostMap::follow(const GridFrame& frame, const CellBox& changed,
                        const CostMapOptions& options) {
  const double r = frame.resolution_m;
  const Cell low = frame.lattice() - frame_.lattice();
  const Cell more(frame.width_cells - frame_.width_cells + low.x,
                  frame.height_cells - frame_.height_cells + low.y);
  if (frame_.width_cells == 0 || !(options == options_) || r != frame_.resolution_m ||
      low.x > 0 || low.y > 0 || more.x < 0 || more.y < 0) {
    start(frame, options);
    return frame.box();
  }
  const Margins margins{-low.x, -low.y, more.x, more.y};
  if (margins.any()) {
    states_.grow(margins);
    for (auto* layer : {&occupied_, &mast_, &traversable_, &clear_, &pocket_}) {
      layer->grow(margins);
    }
    body_field_.grow(margins);
    mast_field_.grow(margins);
    cost_.grow(margins);
    const Cell shift(margins.left, margins.bottom);
    const CellBox old{shift, shift + Cell(frame_.width_cells - 1, frame_.height_cells - 1)};
    if (!active_.empty()) active_ = {active_.low + shift, active_.high + shift};
    // The new cells hold nothing yet; sources near the old edge reach into some of them.
    add_frame_of(old.grown(body_field_.reach_cells()).clipped_to(frame.box()), old, added_);
  }
  frame_ = frame;
  return changed.clipped_to(frame.box());
}

void CostMap::set_active(const CellBox& active) {
  if (active == active_) return;
  const CellBox both = active.clipped_to(active_);
  if (active_.empty() || !(both == active_)) {
    dirty_.push_back(active_);
    dirty_.push_back(active);
  } else {
    add_frame_of(active, active_, dirty_);
  }
  active_ = active;
}

void CostMap::take_row(int j, int i0, std::span<const CellState> states,
                       std::span<const std::uint8_t> mast) {
  static_assert(sizeof(CellState) == 1);
  CellState* old = states_.row(j) + i0;
  std::uint8_t* old_mast = mast_.row(j) + i0;
  // Most rows are as they were.
  if (std::memcmp(old, states.data(), states.size()) != 0) {
    std::uint8_t* occupied = occupied_.row(j) + i0;
    for (std::size_t i = 0; i < states.size(); ++i) {
      if (old[i] == states[i]) continue;
      const Cell cell(i0 + static_cast<int>(i), j);
      changed_.add(cell);
      old[i] = states[i];
      const std::uint8_t hit = states[i] == CellState::kOccupied ? 1 : 0;
      if (occupied[i] != hit) body_changed_.add(cell);
      occupied[i] = hit;
    }
  }
  if (std::memcmp(old_mast, mast.data(), mast.size()) != 0) {
    for (std::size_t i = 0; i < mast.size(); ++i) {
      if (old_mast[i] != mast[i]) mast_changed_.add(Cell(i0 + static_cast<int>(i), j));
    }
    std::copy(mast.begin(), mast.end(), old_mast);
  }
}

// ---- What follows from it

void CostMap::make_tables() {
  const double r = frame_.resolution_m;
  const auto radius = static_cast<float>(options_.robot_radius_m + options_.margin_m);
  const auto mast_radius = static_cast<float>(options_.mast_radius_m);
  const float soft = std::max(static_cast<float>(options_.soft_distance_m), radius + 1e-3F);
  const auto weight = static_cast<float>(options_.soft_weight);
  const double reach_m = std::max({kReach_m, static_cast<double>(soft),
                                   static_cast<double>(radius), options_.mast_radius_m});
  const int reach = std::clamp(static_cast<int>(std::ceil(reach_m / r)), 1, 100);
  const auto count = static_cast<std::size_t>(reach * reach + 2);
  clearance_table_m_.assign(count, kFar_m);
  cost_table_.assign(count, 1.0F);
  room_table_.assign(count, 1);
  mast_room_table_.assign(count, 1);
  for (std::size_t d2 = 0; d2 < count; ++d2) {
    // The last entry stands for everything farther away.
    if (d2 + 1 < count) {
      clearance_table_m_[d2] = std::sqrt(static_cast<float>(d2)) * static_cast<float>(r);
    }
    const float clearance = clearance_table_m_[d2];
    room_table_[d2] = clearance >= radius ? 1 : 0;
    mast_room_table_[d2] = clearance >= mast_radius ? 1 : 0;
    // Quadratic: cheap in the middle of a corridor, steep next to the wall.
    const float near = std::clamp((soft - clearance) / (soft - radius), 0.0F, 1.0F);
    cost_table_[d2] = 1.0F + weight * near * near;
  }
  const auto influence_cells = [&](const auto& says_something) {
    std::size_t d2 = count;
    while (d2 > 0 && !says_something(d2 - 1)) --d2;
    return static_cast<int>(std::ceil(std::sqrt(static_cast<double>(d2))));
  };
  body_influence_cells_ = influence_cells(
      [&](std::size_t d2) { return room_table_[d2] == 0 || cost_table_[d2] != 1.0F; });
  mast_influence_cells_ =
      influence_cells([&](std::size_t d2) { return mast_room_table_[d2] == 0; });
}

void CostMap::finish() {
  for (const CellBox& box : added_) {
    body_field_.compute(occupied_, box);
    mast_field_.compute(mast_, box);
  }
  body_field_.update(occupied_, body_changed_);
  mast_field_.update(mast_, mast_changed_);
  // What changed lies in one view, so that one box holds it.
  changed_.add(body_changed_.grown(body_influence_cells_));
  changed_.add(mast_changed_.grown(mast_influence_cells_));
  dirty_.push_back(changed_);
  for (CellBox& box : dirty_) {
    box = box.clipped_to(frame_.box());
    for (int j = box.low.y; j <= box.high.y; ++j) combine_row(j, box.low.x, box.high.x);
  }
  if (!options_.cross_unknown && options_.fill_pocket_m2 > 0.0) {
    visited_.cover_like(states_);
    visit_ += 2;
    for (const CellBox& box : dirty_) fill_pockets(box);
  }
  added_.clear();
  dirty_.clear();
  changed_ = body_changed_ = mast_changed_ = {};
}

void CostMap::combine_row(int j, int i0, int i1) {
  const std::int16_t* body = body_field_.row(j);
  const std::int16_t* mast = mast_field_.row(j);
  const bool row_active = j >= active_.low.y && j <= active_.high.y;
  const auto unknown_cost = static_cast<float>(options_.unknown_cost);
  for (int i = i0; i <= i1; ++i) {
    const auto d2 = static_cast<std::size_t>(body[i]);
    const bool inside = row_active && i >= active_.low.x && i <= active_.high.x;
    const bool clear = inside && room_table_[d2] != 0 &&
                       mast_room_table_[static_cast<std::size_t>(mast[i])] != 0;
    const CellState state = states_(i, j);
    const bool free = state == CellState::kFree;
    std::uint8_t& pocket = pocket_(i, j);
    if (!clear || state != CellState::kUnknown) pocket = 0;
    clear_(i, j) = clear ? 1 : 0;
    traversable_(i, j) = (clear && (free || options_.cross_unknown)) || pocket != 0 ? 1 : 0;
    float cost = inside ? cost_table_[d2] : 1.0F;
    if (inside && options_.cross_unknown && !free) cost *= unknown_cost;
    cost_(i, j) = cost;
  }
}

/// Decides for every group of unknown cells that touches the box whether it is a pocket.
void CostMap::fill_pockets(const CellBox& around) {
  const CellBox box = around.grown(1).clipped_to(active_);
  for (int j = box.low.y; j <= box.high.y; ++j) {
    for (int i = box.low.x; i <= box.high.x; ++i) {
      const std::ptrdiff_t index = states_.index_of({i, j});
      if (may_be_pocket(index) && visited_.plane()[index] < visit_) visit_pocket(index);
    }
  }
}

/// Spreads from the cell until the group ends, or is too large, or reaches the edge of what is
/// active (it goes on beyond it), or another one that is.
void CostMap::visit_pocket(std::ptrdiff_t seed) {
  const double cell_m2 = frame_.resolution_m * frame_.resolution_m;
  std::uint32_t* visited = visited_.plane();
  queue_.assign(1, seed);
  visited[seed] = visit_;
  bool large = false;
  for (std::size_t k = 0; k < queue_.size() && !large; ++k) {
    const Cell at = states_.cell_of(queue_[k]);
    large = at.x == active_.low.x || at.y == active_.low.y || at.x == active_.high.x ||
            at.y == active_.high.y ||
            !(static_cast<double>(queue_.size()) * cell_m2 < options_.fill_pocket_m2);
    for (int n = 0; n < 9 && !large; ++n) {
      const std::ptrdiff_t next = queue_[k] + (n / 3 - 1) * states_.stride() + n % 3 - 1;
      if (!may_be_pocket(next)) continue;
      large = visited[next] == visit_ + 1;
      if (visited[next] >= visit_) continue;
      visited[next] = visit_;
      queue_.push_back(next);
    }
  }
  if (large) {
    empty_pockets_in_queue();
  } else {
    for (const std::ptrdiff_t k : queue_) pocket_.plane()[k] = traversable_.plane()[k] = 1;
  }
}

/// The queue's cells are part of something large; so are pockets of old that they touch.
void CostMap::empty_pockets_in_queue() {
  std::uint8_t* pocket = pocket_.plane();
  std::uint32_t* visited = visited_.plane();
  for (const std::ptrdiff_t k : queue_) visited[k] = visit_ + 1;
  for (std::size_t k = 0; k < queue_.size(); ++k) {
    if (pocket[queue_[k]] == 0) continue;
    pocket[queue_[k]] = traversable_.plane()[queue_[k]] = 0;
    for (int n = 0; n < 9; ++n) {
      const std::ptrdiff_t next = queue_[k] + (n / 3 - 1) * states_.stride() + n % 3 - 1;
      // There are no pockets outside of the active part.
      if (pocket[next] == 0 || visited[next] == visit_ + 1) continue;
      visited[next] = visit_ + 1;
      queue_.push_back(next);
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
  if (!frame_.contains(cell)) return kFar_m;
  return clearance_table_m_[static_cast<std::size_t>(
      body_field_.squared_cells(cell.x, cell.y))];
}
float CostMap::mast_clearance_m(const Cell& cell) const {
  if (!frame_.contains(cell)) return kFar_m;
  return clearance_table_m_[static_cast<std::size_t>(
      mast_field_.squared_cells(cell.x, cell.y))];
}
float CostMap::length_cost(const Cell& cell) const {
  return frame_.contains(cell) ? cost_(cell.x, cell.y) : 1.0F;
}

CostMapOptions tightened(CostMapOptions options, double radius_m) {
  options.robot_radius_m = std::min(options.robot_radius_m, radius_m);
  options.margin_m = 0.0;
  return options;
}

}  // namespace segsim::nav
