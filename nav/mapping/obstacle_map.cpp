#include "nav/mapping/obstacle_map.h"

#include <algorithm>
#include <cmath>

#include <glm/mat3x3.hpp>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/check.h"
#include "nav/grid/robot_pose.h"

namespace segsim::nav {
namespace {

cv::Mat header(GridLayer<std::uint8_t>& cells) {
  return {cells.height_cells(), cells.width_cells(), CV_8U, cells.row(0),
          static_cast<std::size_t>(cells.stride())};
}

glm::dvec2 robot_of(const core::Observation& observation) {
  return glm::dvec2(observation.T_odom_robot.translation_m());
}

cv::Mat square(int cells) { return cv::getStructuringElement(cv::MORPH_RECT, {cells, cells}); }

}  // namespace

int navigable_kernel_cells(double robot_radius_m, double resolution_m) {
  // A tiny push, so that 0.18 m at 0.05 m is not at the mercy of rounding.
  const int cells = static_cast<int>(2.0 * robot_radius_m / resolution_m + 1e-9);
  return cells % 2 == 0 ? cells + 1 : cells;
}

ObstacleMap::ObstacleMap(const ObstacleMapOptions& options, const VlfmRules& rules)
    : options_(options), rules_(rules) {
  SEGSIM_CHECK(options.band_max_m > options.band_min_m, "obstacle band is empty");
  SEGSIM_CHECK(options.growth.resolution_m > 0.0 && options.robot_radius_m >= 0.0,
               "resolution or radius");
  if (rules_.published(Quirk::kMapEdge)) {
    const double resolution_m = options_.growth.resolution_m;
    options_.growth = published_square();
    options_.growth.resolution_m = resolution_m;
  }
  reset();
}

void ObstacleMap::reset() {
  frame_ = {};
  for (auto* layer : {&occupied_, &mast_, &navigable_, &explored_}) *layer = {};
  exhausted_ = false;
  touched_ = changed_ = {};
  occupancy_.reset();
  if (!rules_.published(Quirk::kObstaclesStay)) {
    OccupancyOptions occupancy = options_.occupancy;
    occupancy.growth = options_.growth;
    occupancy.growth.wrap = false;
    occupancy.obstacle_min_m = options_.band_min_m;
    occupancy.obstacle_max_m = options_.band_max_m;
    occupancy.max_range_m = options_.depth.max_depth_m;
    occupancy_.emplace(occupancy);
  }
}

void ObstacleMap::ensure_covers(const glm::dvec2& robot_m) {
  if (frame_.width_cells == 0) frame_ = first_frame(options_.growth, robot_m);
  const double reach_m = options_.depth.max_depth_m + 1.0;
  const auto margins = grow(frame_, options_.growth, robot_m - reach_m, robot_m + reach_m);
  if (!margins) {
    // A wrapping map ends where an index is too large; a growing one where it may not grow.
    const Cell robot = frame_.cell_at(robot_m);
    exhausted_ |= options_.growth.wrap ? !wrapped(frame_, robot) : !frame_.contains(robot);
  }
  occupied_.cover(frame_, margins);
  explored_.cover(frame_, margins);
  navigable_.cover(frame_, margins, 1);
  if (occupancy_) mast_.cover(frame_, margins);
}

/// Every pixel whose point lies in the band occupies its cell, once and for all.
void ObstacleMap::mark_monotone(const core::Observation& observation) {
  const auto T_odom_camera = observation.T_odom_camera();
  const glm::dmat3 R = glm::mat3_cast(T_odom_camera.rotation());
  const glm::dvec3 eye = T_odom_camera.translation_m();
  const core::CameraIntrinsics& camera = observation.intrinsics;
  const auto eye_z = static_cast<float>(eye.z - observation.T_odom_robot.translation_m().z);
  const auto min_z = static_cast<float>(options_.band_min_m);
  const auto max_z = static_cast<float>(options_.band_max_m);
  const auto far = static_cast<float>(options_.depth.max_depth_m);
  const auto per_cell = static_cast<float>(1.0 / frame_.resolution_m);
  const glm::vec2 eye_cells((glm::dvec2(eye) - frame_.origin_m) / frame_.resolution_m);
  const int width = depth_m_.width_px(), height = depth_m_.height_px();
  std::vector<glm::vec3> columns(static_cast<std::size_t>(width));
  for (int x = 0; x < width; ++x) {
    columns[static_cast<std::size_t>(x)] =
        glm::vec3(R[0] * ((x + 0.5 - camera.cx_px) / camera.fx_px) + R[2]);
  }
  for (int y = 0; y < height; ++y) {
    const glm::vec3 row(R[1] * ((y + 0.5 - camera.cy_px) / camera.fy_px));
    const float* depth_row = depth_m_.row(y);
    for (int x = 0; x < width; ++x) {
      const float depth = depth_row[x];
      if (!(depth < far)) continue;  // NaN too.
      const glm::vec3 d = columns[static_cast<std::size_t>(x)] + row;
      const float z = eye_z + depth * d.z;
      if (!(z >= min_z && z <= max_z)) continue;
      Cell cell(static_cast<int>(std::floor(eye_cells.x + depth * d.x * per_cell)),
                static_cast<int>(std::floor(eye_cells.y + depth * d.y * per_cell)));
      if (!frame_.contains(cell)) {
        const auto other = options_.growth.wrap ? wrapped(frame_, cell) : std::nullopt;
        if (!other) {
          exhausted_ |= options_.growth.wrap;
          continue;
        }
        cell = *other;
      }
      occupied_(cell.x, cell.y) = 1;
    }
  }
}

/// Our cell of the log-odds map's first one.
Cell ObstacleMap::shift_of(const OccupancyMap& map) const {
  const glm::dvec2 shift_cells =
      (map.frame().origin_m - frame_.origin_m) / frame_.resolution_m;
  return {static_cast<int>(std::lround(shift_cells.x)),
          static_cast<int>(std::lround(shift_cells.y))};
}

/// Takes over what the log-odds map says about the cells that this view changed.
/// @return  Holds the cells of which that is news, in our frame.
CellBox ObstacleMap::take_log_odds(const core::Observation& observation) {
  const core::Image<float>& depth_m = *observation.depth_m;
  const int n = thinning_of(depth_m);
  core::Observation cleaned = observation;
  cleaned.intrinsics = thinned_camera(observation.intrinsics, n);
  cleaned.depth_m = &depth_m_;
  if (rules_.published(Quirk::kZeroDepth)) {  // Filling looks at neighbours.
    core::Image<float> filled_m;
    clean_depth_m(depth_m, rules_, options_.depth, filled_m);
    thin_out(filled_m, n, depth_m_);
  } else if (n == 1) {
    clean_depth_m(depth_m, rules_, options_.depth, depth_m_);
  } else {
    thin_out(depth_m, n, thinned_m_);
    clean_depth_m(thinned_m_, rules_, options_.depth, depth_m_);
  }
  occupancy_->integrate(cleaned);
  const Cell shift = shift_of(*occupancy_);
  const float above = occupancy_->options().occupied_above;
  CellBox box = occupancy_->take_changed();
  if (box.empty()) return {};
  box = CellBox{box.low + shift, box.high + shift}.clipped_to(frame_.box());
  CellBox news;
  for (int to_j = box.low.y; to_j <= box.high.y; ++to_j) {
    const float* body = occupancy_->body_log_odds().row(to_j - shift.y);
    const float* mast = occupancy_->mast_log_odds().row(to_j - shift.y);
    std::uint8_t* occupied = occupied_.row(to_j);
    std::uint8_t* hanging = mast_.row(to_j);
    for (int i = box.low.x; i <= box.high.x; ++i) {
      const std::uint8_t hit = body[i - shift.x] > above ? 1 : 0;
      const std::uint8_t hung = mast[i - shift.x] > above ? 1 : 0;
      if (hit == occupied[i] && hung == hanging[i]) continue;
      occupied[i] = hit;
      hanging[i] = hung;
      news.add(Cell(i, to_j));
    }
  }
  return news;
}

void ObstacleMap::note_changed(const CellBox& cells) {
  const CellBox inside = cells.clipped_to(frame_.box());
  if (inside.empty()) return;
  const Cell lattice = frame_.lattice();
  const CellBox on_lattice{inside.low + lattice, inside.high + lattice};
  changed_.add(on_lattice);
  touched_.add(on_lattice);
}

CellBox ObstacleMap::observed() const {
  if (touched_.empty()) return {};
  const Cell lattice = frame_.lattice();
  const CellBox box =
      CellBox{touched_.low - lattice, touched_.high - lattice}.clipped_to(frame_.box());
  // Whole rows at once: which columns hold something, and which rows?
  CellBox observed;
  std::vector<std::uint8_t> columns(static_cast<std::size_t>(box.width()), 0);
  for (int j = box.low.y; j <= box.high.y; ++j) {
    const std::uint8_t* explored = explored_.row(j) + box.low.x;
    const std::uint8_t* occupied = occupied_.row(j) + box.low.x;
    std::uint8_t any = 0;
    for (std::size_t i = 0; i < columns.size(); ++i) {
      const auto set = static_cast<std::uint8_t>(explored[i] | occupied[i]);
      columns[i] |= set;
      any |= set;
    }
    if (any != 0) observed.add(Cell(box.low.x, j));
  }
  if (observed.empty()) return {};
  const auto is_set = [](std::uint8_t value) { return value != 0; };
  const auto first = std::find_if(columns.begin(), columns.end(), is_set);
  const auto last = std::find_if(columns.rbegin(), columns.rend(), is_set);
  observed.low.x = box.low.x + static_cast<int>(first - columns.begin());
  observed.high.x = box.high.x - static_cast<int>(last - columns.rbegin());
  return observed;
}

CellBox ObstacleMap::take_changed() {
  const Cell lattice = frame_.lattice();
  const CellBox changed = changed_;
  changed_ = {};
  if (changed.empty()) return {};
  return {changed.low - lattice, changed.high - lattice};
}

/// Recomputes the cells of the (inclusive) window; the squares reach beyond it.
void ObstacleMap::update_navigable(const Cell& low, const Cell& high) {
  const int k = navigable_kernel_cells(options_.robot_radius_m, frame_.resolution_m);
  const int i0 = std::max(low.x - k, 0), j0 = std::max(low.y - k, 0);
  const int i1 = std::min(high.x + k, frame_.width_cells - 1);
  const int j1 = std::min(high.y + k, frame_.height_cells - 1);
  if (i0 > i1 || j0 > j1) return;
  const cv::Rect window(i0, j0, i1 - i0 + 1, j1 - j0 + 1);
  cv::Mat blocked;
  cv::dilate(header(occupied_)(window), blocked, square(k));
  if (occupancy_) {
    const int m = navigable_kernel_cells(options_.mast_radius_m, frame_.resolution_m);
    cv::Mat mast;
    cv::dilate(header(mast_)(window), mast, square(m));
    blocked |= mast;
  }
  cv::Mat navigable = header(navigable_)(window);
  navigable.setTo(1);
  navigable.setTo(0, blocked);
  cv::Mat explored = header(explored_)(window);
  cv::bitwise_and(explored, navigable, explored);
  note_changed({{i0, j0}, {i1, j1}});
}

void ObstacleMap::keep_component_of(const glm::dvec2& robot_m) {
  std::vector<std::vector<cv::Point>> outlines;
  cv::findContours(header(explored_), outlines, cv::RETR_EXTERNAL, cv::CHAIN_APPROX_SIMPLE);
  if (outlines.size() < 2) return;
  const Cell robot = frame_.cell_at(robot_m);
  const cv::Point2f at(static_cast<float>(robot.x), static_cast<float>(robot.y));
  std::size_t best = 0;
  double best_distance = -1e18;
  for (std::size_t k = 0; k < outlines.size(); ++k) {
    // Positive inside; outside the least negative one is the nearest.
    const double distance = cv::pointPolygonTest(outlines[k], at, true);
    if (distance > best_distance) {
      best_distance = distance;
      best = k;
    }
  }
  cv::Mat kept(explored_.height_cells(), explored_.width_cells(), CV_8U, cv::Scalar(0));
  cv::drawContours(kept, outlines, static_cast<int>(best), cv::Scalar(1), cv::FILLED);
  cv::Mat explored = header(explored_);
  cv::bitwise_and(explored, kept, explored);
}

/// Explores the navigable cells of the box that the log-odds map knows to be free.
void ObstacleMap::reveal_measured(const CellBox& box) {
  const Cell shift = shift_of(*occupancy_);
  for (int j = box.low.y; j <= box.high.y; ++j) {
    for (int i = box.low.x; i <= box.high.x; ++i) {
      if (navigable_(i, j) != 0 &&
          occupancy_->body_state(Cell(i, j) - shift) == CellState::kFree) {
        explored_(i, j) = 1;
      }
    }
  }
}

void ObstacleMap::reveal(const core::Observation& observation) {
  FogOptions fog = options_.fog;
  fog.hfov_rad = observation.intrinsics.horizontal_fov_rad();
  fog.range_m = options_.depth.max_depth_m;
  CellWindow window = revealed_cells(frame_, navigable_, robot_of(observation),
                                     pose_of(observation.T_odom_robot).yaw_rad, fog, rules_);
  cv::Mat piece(window.cells.height_px(), window.cells.width_px(), CV_8U, window.cells.data());
  cv::dilate(piece, piece, square(3));
  const CellBox box = CellBox{window.low, window.low + Cell(window.cells.width_px() - 1,
                                                            window.cells.height_px() - 1)}
                          .clipped_to(frame_.box());
  for (int j = box.low.y; j <= box.high.y; ++j) {
    const std::uint8_t* shown = window.cells.row(j - window.low.y) - window.low.x;
    const std::uint8_t* navigable = navigable_.row(j);
    std::uint8_t* explored = explored_.row(j);
    for (int i = box.low.x; i <= box.high.x; ++i) {
      explored[i] = static_cast<std::uint8_t>((explored[i] | shown[i]) & navigable[i]);
    }
  }
  const Cell robot = frame_.cell_at(robot_of(observation));
  const bool enclosed = frame_.contains(robot) && navigable_(robot.x, robot.y) == 0;
  if (options_.measured_where_enclosed && occupancy_ && enclosed) reveal_measured(box);
  note_changed(box);
  if (rules_.published(Quirk::kOneComponent)) {
    keep_component_of(robot_of(observation));
    note_changed(frame_.box());
  }
}

void ObstacleMap::update(const core::Observation& observation) {
  SEGSIM_CHECK(observation.depth_m != nullptr, "observation without depth");
  const glm::dvec2 robot = robot_of(observation);
  ensure_covers(robot);
  const glm::dvec2 reach(options_.depth.max_depth_m + 1.0);
  Cell low = frame_.cell_at(robot - reach), high = frame_.cell_at(robot + reach);
  if (exhausted_) return;  // What does not fit is not mapped.
  if (occupancy_) {
    const CellBox news = take_log_odds(observation);
    low = news.low;
    high = news.high;
  } else {
    clean_depth_m(*observation.depth_m, rules_, options_.depth, depth_m_);
    mark_monotone(observation);
    if (options_.growth.wrap && !(frame_.contains(low) && frame_.contains(high))) {
      low = {0, 0};
      high = {frame_.width_cells - 1, frame_.height_cells - 1};
    }
  }
  if (low.x <= high.x) update_navigable(low, high);
  reveal(observation);
}

void ObstacleMap::mark_blocked_disc(const glm::dvec2& center_odom_m, double radius_m) {
  if (frame_.width_cells == 0) return;
  if (occupancy_) occupancy_->mark_blocked_disc(center_odom_m, radius_m);
  const Cell low = frame_.cell_at(center_odom_m - radius_m);
  const Cell high = frame_.cell_at(center_odom_m + radius_m);
  for (int j = std::max(low.y, 0); j <= std::min(high.y, frame_.height_cells - 1); ++j) {
    for (int i = std::max(low.x, 0); i <= std::min(high.x, frame_.width_cells - 1); ++i) {
      const glm::dvec2 offset = frame_.center_m({i, j}) - center_odom_m;
      if (offset.x * offset.x + offset.y * offset.y <= radius_m * radius_m) {
        occupied_(i, j) = 1;
      }
    }
  }
  update_navigable(low, high);
}

}  // namespace segsim::nav
