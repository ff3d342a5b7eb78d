#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "nav/frontier/internal/search_policy.h"
#include "nav/grid/robot_pose.h"

namespace segsim::nav::internal {
namespace {

constexpr double kSameTarget_m = 0.5;  // A target that moved less is the same one.
constexpr double kProgress_m = 0.3;    // Coming nearer by this much is progress.

SpinOptions spin_of(const FrontierPolicyOptions& options) {
  SpinOptions spin = options.spin;
  spin.rate_radps = std::min(spin.rate_radps, options.follower.max_turn_radps);
  return spin;
}

}  // namespace

SearchPolicy::SearchPolicy(const FrontierPolicyOptions& options)
    : options_(options),
      map_(options.occupancy),
      objects_(options.objects),
      selector_(options.selector, options.scorer),
      follower_(options.follower),
      spin_(spin_of(options)),
      recovery_(options.recovery, options.occupancy.footprint_radius_m),
      sweep_(options.sweep),
      verification_(options.verification),
      replan_(options.replan_period_s) {}

void SearchPolicy::reset(const core::ObjectGoal& goal, std::uint64_t seed) {
  *this = SearchPolicy(options_);
  goal_ = goal;
  recovery_.reset(seed);
}

core::Decision SearchPolicy::decide(const core::Observation& observation,
                                    std::span<const core::Detection> detections) {
  core::Decision decision;
  if (!finite_pose(observation)) return decision;  // Wait for the next one.
  const Now now = moment_of(observation);
  if (state_ != State::kStopped) {
    map_.integrate(observation);
    if (map_.exhausted()) stop(core::StopReason::kMapExhausted);
  }
  if (state_ != State::kStopped) {
    note_map_changes();
    cost_fresh_ = false;
    objects_.update(observation, detections, goal_.class_index);
    postponed_until_ns_.resize(objects_.objects().size(), -1);
    if (!begun_) begin_spin();
    begun_ = true;
    decision.command = act(now);
  }
  decision.mode = mode();
  if (state_ == State::kStopped) {
    decision.command = {};
    decision.stop = stop_reason_;
  }
  spin_.end_decision(now.pose.yaw_rad);
  return decision;
}

core::PolicyMode SearchPolicy::mode() const {
  switch (state_) {
    case State::kSpin:
      return core::PolicyMode::kInitialize;
    case State::kExplore:
    case State::kLook:
    case State::kSweep:
      return core::PolicyMode::kExplore;
    case State::kNavigate:
    case State::kVerify:
      return core::PolicyMode::kNavigate;
    case State::kRecover:
      return core::PolicyMode::kRecover;
    case State::kStopped:
      break;
  }
  return core::PolicyMode::kStop;
}

core::VelocityCommand SearchPolicy::act(const Now& now) {
  refresh_cost_map();
  if (recovery_.due()) begin_recovery(now);
  // Objects interrupt exploring, not the first look around (VLFM's order) and not recovering.
  if (mode() == core::PolicyMode::kExplore) {
    if (const MappedObject* object = best_object(now)) begin_navigate(object->id);
  }
  const core::VelocityCommand command = perform(now);
  if (!recovery_.active()) recovery_.watch(now.pose, command, follower_.blocked());
  return command;
}

/// One decision of the present state; it may lead to another one.
core::VelocityCommand SearchPolicy::perform(const Now& now) {
  switch (state_) {
    case State::kSpin:
      return spin(now);
    case State::kExplore:
      return explore(now);
    case State::kLook:
      return look(now);
    case State::kSweep:
      return sweep(now);
    case State::kNavigate:
      return navigate(now);
    case State::kVerify:
      return verify(now);
    case State::kRecover:
      return recover(now);
    case State::kStopped:
      break;
  }
  return {};
}

// ---- Maps and targets

bool SearchPolicy::replan_due(const Now& now) const {
  return !follower_.has_path() || replan_.due(now.time_ns);
}

void SearchPolicy::refresh_cost_map() {
  if (cost_fresh_) return;
  cost_.update(map_, on_map(cost_changed_),
               effort_ == Effort::kNormal ? options_.cost
                                          : tightened(options_.cost, options_.tight_radius_m));
  cost_changed_ = {};
  cost_fresh_ = true;
}

void SearchPolicy::note_map_changes() {
  const CellBox changed = map_.take_changed();
  if (changed.empty()) return;
  const Cell lattice = map_.frame().lattice();
  cost_changed_.add(CellBox{changed.low + lattice, changed.high + lattice});
  bold_changed_.add(CellBox{changed.low + lattice, changed.high + lattice});
}

CellBox SearchPolicy::on_map(const CellBox& on_lattice) const {
  if (on_lattice.empty()) return {};
  const Cell lattice = map_.frame().lattice();
  return {on_lattice.low - lattice, on_lattice.high - lattice};
}

void SearchPolicy::build_bold_map() {
  CostMapOptions options = tightened(options_.cost, options_.tight_radius_m);
  options.cross_unknown = true;
  bold_.update(map_, on_map(bold_changed_), options);
  bold_changed_ = {};
}

void SearchPolicy::track_target(const Now& now, const glm::dvec2& target_m,
                                const glm::dvec2& outward) {
  if (!target_ || glm::distance(target_->position_m, target_m) > kSameTarget_m) {
    target_ = Target{target_m, outward, now.time_ns, now.time_ns, 1e18};
  }
  target_->position_m = target_m;
  target_->outward = outward;
  const double to_go_m = follower_.path().length_m;
  if (to_go_m < target_->best_to_go_m - kProgress_m) {
    target_->best_to_go_m = to_go_m;
    target_->progress_ns = now.time_ns;
  }
}

bool SearchPolicy::hopeless(const Now& now) {
  return target_ &&
         (core::seconds(now.time_ns - target_->since_ns) > options_.target_timeout_s ||
          core::seconds(now.time_ns - target_->progress_ns) > options_.no_progress_s);
}

bool SearchPolicy::drive_to(const Now& now, const glm::dvec2& place_m, const CostMap& map) {
  const std::optional<Path> path = plan_path(map, now.position_m, place_m, &planner_);
  if (!path) return false;
  follower_.set_path(*path);
  return true;
}

void SearchPolicy::stop(core::StopReason reason) {
  state_ = State::kStopped;
  stop_reason_ = reason;
  follower_.clear();
}

// ---- Recovering

void SearchPolicy::begin_recovery(const Now& now) {
  if (recovery_.exhausted()) {
    stop(core::StopReason::kStuck);
    return;
  }
  if (const std::optional<FeltDisc> felt = recovery_.begin(now)) {
    map_.mark_blocked_disc(felt->center_m, felt->radius_m);
    note_map_changes();
    cost_fresh_ = false;
    refresh_cost_map();
  }
  before_recovery_ = state_;
  state_ = State::kRecover;
  follower_.clear();
}

core::VelocityCommand SearchPolicy::recover(const Now& now) {
  if (const auto command = recovery_.command(now, follower_, cost_)) return *command;
  // What needs a place to stand at has to drive there again.
  const bool verifying = before_recovery_ == State::kVerify;
  const bool looking = before_recovery_ == State::kLook;
  state_ = verifying ? State::kNavigate : looking ? State::kExplore : before_recovery_;
  replan_.demand();
  return {};
}

core::PolicyView SearchPolicy::view() const {
  core::PolicyView view;
  const GridFrame& frame = cost_.frame();
  view.resolution_m = frame.resolution_m;
  view.origin_m = frame.origin_m;
  if (const CellBox part = cost_.active(); !part.empty()) {
    view.origin_m += glm::dvec2(part.low) * frame.resolution_m;
    view.cells = core::Image<std::uint8_t>(part.width(), part.height());
    for (int j = 0; j < part.height(); ++j) {
      for (int i = 0; i < part.width(); ++i) {
        const Cell cell = part.low + Cell(i, j);
        const CellState state = cost_.state(cell);
        const bool inflated = state == CellState::kFree && !cost_.clear(cell);
        view.cells(i, j) = inflated ? 3 : static_cast<std::uint8_t>(state);
      }
    }
  }
  for (const Frontier& frontier : frontiers_) view.frontiers_m.push_back(frontier.waypoint_m);
  view.path_m = follower_.path().points_m;
  if (target_) view.target_m = target_->position_m;
  for (const MappedObject& object : objects_.objects()) {
    if (object.status == ObjectStatus::kRefuted) continue;
    view.objects.push_back(
        {glm::dvec2(object.center_m), goal_.class_index, object.best_score, object.made_of});
  }
  return view;
}

}  // namespace segsim::nav::internal
