#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include <glm/geometric.hpp>

#include "core/check.h"
#include "nav/grid/robot_pose.h"
#include "nav/planning/approach.h"
#include "nav/vlfm/internal/vlfm_search.h"

namespace segsim::nav::internal {
namespace {

constexpr double kAtFrontier_m = 0.35;
constexpr double kVeto_m = 0.5;
/// Searches until one of the cells is settled: the nearest is among those that are then.
/// @param cells  Of all frontiers; none where no way leads there.
/// @return  Position in the list of the nearest one, the first of equals.
std::size_t nearest_among(const GeodesicField& field,
                          std::span<const std::optional<Cell>> cells,
                          std::span<const std::size_t> list) {
  if (std::none_of(list.begin(), list.end(),
                   [&](std::size_t k) { return cells[k].has_value(); })) {
    return 0;
  }
  while (true) {
    std::optional<std::size_t> best;
    float best_m = std::numeric_limits<float>::infinity();
    for (std::size_t n = 0; n < list.size(); ++n) {
      const std::optional<Cell>& cell = cells[list[n]];
      if (!cell || !field.settled(*cell) || field.cost_m(cell->x, cell->y) >= best_m) continue;
      best = n;
      best_m = field.cost_m(cell->x, cell->y);
    }
    if (best) return *best;
    if (!field.settle_more()) return 0;  // Reachable cells are settled before.
  }
}

VlfmOptions completed(VlfmOptions options) {
  if (options.scorer == nullptr) options.scorer = make_constant_scorer();
  if (options.segmenter == nullptr) options.segmenter = make_depth_segmenter();
  if (options.local == nullptr) {
    GridLocalOptions local;
    local.actions = options.actions;
    options.local = make_grid_local_policy(local);
  }
  SEGSIM_CHECK(options.stop_radius_m > 0.0 && options.spin_turns >= 0, "stop radius, turns");
  SEGSIM_CHECK(options.give_up_s > 0.0, "give_up_s");
  if (options.approach) {
    options.cloud.floor_m = options.approach_floor_m;
    options.cloud.carve_m = options.approach_carve_m;
    options.cloud.support_share = options.approach_support_share;
  }
  if (options.motion == Motion::kDiscrete) {
    options.verification.facing_rad =
        std::max(options.verification.facing_rad, options.actions.turn_above_rad + 0.05);
  }
  return options;
}

SpinOptions spin_of(const VlfmOptions& options) {
  return {options.follower.max_turn_radps, options.spin_turns * options.actions.turn_rad};
}

}  // namespace

VlfmSearch::VlfmSearch(const VlfmOptions& options)
    : options_(completed(options)),
      obstacles_(options_.obstacles, options_.rules),
      values_(options_.values, options_.rules),
      cloud_(options_.cloud, options_.rules),
      chooser_(options_.choice, options_.rules),
      follower_(options_.follower),
      executor_(options_.actions),
      spin_(spin_of(options_)),
      recovery_(options_.recovery, options_.obstacles.robot_radius_m),
      sweep_(options_.sweep),
      verification_(options_.verification),
      replan_(options_.replan_period_s) {}

void VlfmSearch::reset(const core::ObjectGoal& goal, std::uint64_t seed) {
  *this = VlfmSearch(options_);
  goal_ = goal;
  cloud_.reset(seed);
  recovery_.reset(seed);
  options_.local->reset();
}

core::Decision VlfmSearch::decide(const core::Observation& observation,
                                  std::span<const core::Detection> detections) {
  core::Decision decision;
  // Without a pose nothing can be mapped and no way is known: wait.
  if (!stop_reason_ && finite_pose(observation)) {
    const core::TimeNs time_ns = observation.capture_time_ns;
    const double period_s = last_time_ns_ ? core::seconds(time_ns - *last_time_ns_) : 0.1;
    const core::Observation seen = with_depth(observation);
    const Now now{moment_of(seen), detections, period_s};
    update_maps(now);
    decision.command = act(now);
    last_time_ns_ = time_ns;
    spin_.end_decision(now.pose.yaw_rad);
  }
  decision.mode = mode_;
  if (stop_reason_) {
    decision.command = {};
    decision.stop = stop_reason_;
  }
  return decision;
}

core::Observation VlfmSearch::with_depth(const core::Observation& observation) {
  core::Observation seen = observation;
  if (options_.depth == nullptr) return seen;
  options_.depth->infer(observation, inferred_m_);
  const DepthCleanupOptions& range = options_.obstacles.depth;
  for (float& depth_m : inferred_m_.pixels()) {
    const double share =
        normalised_inferred(static_cast<double>(depth_m), options_.rules, range);
    depth_m = static_cast<float>(range.min_depth_m +
                                 share * (range.max_depth_m - range.min_depth_m));
  }
  seen.depth_m = &inferred_m_;
  return seen;
}

void VlfmSearch::update_maps(const Now& now) {
  obstacles_.update(*now.observation);
  values_.update(*now.observation,
                 options_.scorer->score(*now.observation, now.detections, goal_));
  if (options_.sweep.most_places > 0) seen_near_.add(now, values_.last_limits_m());
  std::vector<core::BoxPx> boxes;
  for (const core::Detection& detection : now.detections) {
    if (goal_.class_index < 0 || detection.class_index != goal_.class_index) continue;
    boxes.push_back(detection.box);
    if (static_cast<double>(detection.score) < options_.min_score) continue;
    cloud_.add(*now.observation, options_.segmenter->segment(*now.observation, detection.box),
               detection.box);
  }
  cloud_.carve(*now.observation, boxes);
  cloud_.refute_second_class(*now.observation);
}

core::VelocityCommand VlfmSearch::act(const Now& now) {
  if (obstacles_.exhausted()) {
    stop(core::StopReason::kMapExhausted);
    return {};
  }
  if (nothing_new(now)) {
    if (!squeeze_through()) {
      stop(core::StopReason::kNothingNew);
      return {};
    }
    seen_near_.wait_anew(now.time_ns);
  }
  if (!options_.rules.published(Quirk::kNoRecovery) && recovery_.due()) begin_recovery(now);
  if (stop_reason_) return {};
  if (recovery_.active()) return recover(now);
  const core::VelocityCommand command = perform(now);
  recovery_.watch(now.pose, command, follower_.blocked());
  return command;
}

/// What is under way, else the first look around, else the object, else a frontier.
core::VelocityCommand VlfmSearch::perform(const Now& now) {
  if (executor_.busy()) {
    const core::VelocityCommand command =
        executor_.command(now.pose, now.time_ns, now.period_s);
    if (executor_.busy()) return command;
  }
  // Objects seen during the first spin do not interrupt it.
  if (mode_ == core::PolicyMode::kInitialize) return look_around_first(now);
  const bool postponed = now.time_ns < postponed_until_ns_;
  if (const auto object_m = postponed ? std::nullopt : cloud_.target_m(now.position_m)) {
    mode_ = core::PolicyMode::kNavigate;
    return navigate(now, *object_m);
  }
  mode_ = core::PolicyMode::kExplore;
  verification_.end();
  verification_.forget_far_looks();
  return explore(now);
}

core::VelocityCommand VlfmSearch::look_around_first(const Now& now) {
  if (const auto command = turn_around(now)) return *command;
  mode_ = core::PolicyMode::kExplore;
  return {};
}

bool VlfmSearch::vetoed(const glm::dvec2& place_m) const {
  return std::any_of(vetoed_m_.begin(), vetoed_m_.end(), [&](const glm::dvec2& other_m) {
    return glm::distance(other_m, place_m) <= kVeto_m;
  });
}

/// The frontier to visit. Fixed Q6 leaves out those that cannot be reached or were visited.
std::optional<glm::dvec2> VlfmSearch::choose_frontier(const Now& now) {
  refresh_cost_map();
  frontiers_ = obstacles_.frontiers();
  const bool known = field_.begin(cost_, cost_.frame().cell_at(now.position_m));
  const auto reached_at = [&](const glm::dvec2& place_m) -> std::optional<Cell> {
    const auto cell = nearest_traversable(cost_, cost_.frame().cell_at(place_m), 0.3);
    return cell && known && field_.reachable(*cell) ? cell : std::nullopt;
  };
  const bool as_published = options_.rules.published(Quirk::kNoRecovery);
  std::vector<ValuedFrontier> candidates;
  std::vector<std::optional<Cell>> cells;  // Where the way to each of them ends.
  for (const ContourFrontier& frontier : frontiers_) {
    if (!as_published && vetoed(frontier.waypoint_m)) continue;
    const std::optional<Cell> cell = reached_at(frontier.waypoint_m);
    if (!as_published && !cell) continue;
    const auto value = values_.median_around(frontier.waypoint_m, options_.value_radius_m);
    candidates.push_back({frontier.waypoint_m, value.value_or(options_.choice.unseen_value)});
    cells.push_back(cell);
  }
  FloorWays ways;
  ways.length_m = [&](std::size_t k) {
    return cells[k] ? static_cast<double>(field_.cost_m(cells[k]->x, cells[k]->y))
                    : std::numeric_limits<double>::infinity();
  };
  ways.nearest = [&](std::span<const std::size_t> list) {
    return nearest_among(field_, cells, list);
  };
  const auto chosen = chooser_.choose(now.position_m, candidates, ways);
  if (!chosen) return std::nullopt;
  return candidates[*chosen].place_m;
}

core::VelocityCommand VlfmSearch::explore(const Now& now) {
  if (options_.motion == Motion::kDiscrete || replan_due(now)) {
    target_m_ = choose_frontier(now);
    replan_.demand();
  }
  if (sweep_spinning_) {
    const auto command = turn_around(now);
    sweep_spinning_ = command.has_value();
    return command.value_or(core::VelocityCommand{});
  }
  if (!target_m_) {
    if (const auto place_m = next_sweep_place(now)) return sweep_to(now, *place_m);
    if (!squeeze_through()) stop(core::StopReason::kNoFrontierLeft);
    return {};
  }
  sweep_.leave(now.time_ns);
  // A frontier that is still there when the robot stands on it will not go away.
  if (!options_.rules.published(Quirk::kNoRecovery) &&
      glm::distance(*target_m_, now.position_m) < kAtFrontier_m) {
    vetoed_m_.push_back(*target_m_);
    follower_.clear();
    return {};
  }
  return drive(now, *target_m_, true);
}

void VlfmSearch::stop(core::StopReason reason) {
  stop_reason_ = reason;
  mode_ = core::PolicyMode::kStop;
  follower_.clear();
}

core::PolicyView VlfmSearch::view() const {
  core::PolicyView view;
  const GridFrame& frame = obstacles_.frame();
  view.resolution_m = frame.resolution_m;
  view.origin_m = frame.origin_m;
  view.cells = core::Image<std::uint8_t>(frame.width_cells, frame.height_cells);
  for (int j = 0; j < frame.height_cells; ++j) {
    for (int i = 0; i < frame.width_cells; ++i) {
      const bool hit = obstacles_.occupied()(i, j) != 0;
      const bool free = obstacles_.explored()(i, j) != 0;
      view.cells(i, j) = hit ? 2 : free ? 1 : obstacles_.navigable()(i, j) == 0 ? 3 : 0;
    }
  }
  for (const ContourFrontier& f : frontiers_) view.frontiers_m.push_back(f.waypoint_m);
  view.path_m = follower_.path().points_m;
  view.target_m = target_m_;
  for (CloudGroup& group : cloud_.groups()) {
    view.objects.push_back(
        {group.center_m, goal_.class_index, 1.0F, std::move(group.made_of)});
  }
  return view;
}

}  // namespace segsim::nav::internal
