#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

#include "core/check.h"
#include "nav/frontier/internal/search_policy.h"
#include "nav/grid/robot_pose.h"

namespace segsim::nav::internal {
namespace {

constexpr double kSameTarget_m = 0.5;  // A target that moved less is the same one.
constexpr double kProgress_m = 0.3;    // Coming nearer by this much is progress.
constexpr double kSamePlace_m = 0.5;   // Recoveries this near to one another count together.
constexpr int kBlockedLimit = 15;      // Decisions without a safe forward motion.
constexpr double kBackSpeed_mps = 0.2;
constexpr double kRecoverPhase_s = 3.0;  // Longest time for backing and for turning each.

}  // namespace

SearchPolicy::SearchPolicy(const FrontierPolicyOptions& options)
    : options_(options),
      map_(options.occupancy),
      objects_(options.objects),
      selector_(options.selector, options.scorer),
      follower_(options.follower),
      stuck_(options.stuck) {}

void SearchPolicy::reset(const core::ObjectGoal& goal, std::uint64_t seed) {
  *this = SearchPolicy(options_);
  goal_ = goal;
  seed_ = seed;
}

core::Decision SearchPolicy::decide(const core::Observation& observation,
                                    std::span<const core::Detection> detections) {
  const core::Pose2 pose = pose_of(observation.T_odom_robot);
  const Now now{&observation, pose, {pose.x_m, pose.y_m}, observation.capture_time_ns};
  core::Decision decision;
  if (!finite_pose(observation)) return decision;  // Wait for the next one.
  if (state_ != State::kStopped) {
    map_.integrate(observation);
    if (map_.exhausted()) stop(core::StopReason::kMapExhausted);
  }
  if (state_ != State::kStopped) {
    note_map_changes();
    cost_fresh_ = false;
    objects_.update(observation, detections, goal_.class_index);
    postponed_until_ns_.resize(objects_.objects().size(), -1);
    if (replanned_ns_ < 0) begin_spin(now);
    decision.command = act(now);
  }
  switch (state_) {
    case State::kSpin:
      decision.mode = core::PolicyMode::kInitialize;
      break;
    case State::kNavigate:
    case State::kVerify:
      decision.mode = core::PolicyMode::kNavigate;
      break;
    case State::kRecover:
      decision.mode = core::PolicyMode::kRecover;
      break;
    case State::kStopped:
      decision.mode = core::PolicyMode::kStop;
      break;
    default:
      decision.mode = core::PolicyMode::kExplore;
      break;
  }
  if (state_ == State::kStopped) {
    decision.command = {};
    decision.stop = stop_reason_;
  }
  last_yaw_rad_ = pose.yaw_rad;
  return decision;
}

core::VelocityCommand SearchPolicy::act(const Now& now) {
  refresh_cost_map();
  if (state_ != State::kRecover && (stuck_.stuck() || blocked_decisions_ > kBlockedLimit)) {
    begin_recovery(now);
  }
  // Objects interrupt exploring, not the first look around (VLFM's order) and not recovering.
  if (state_ == State::kExplore || state_ == State::kLook || state_ == State::kSweep) {
    if (const MappedObject* object = best_object(now)) begin_navigate(now, object->id);
  }
  core::VelocityCommand command;
  switch (state_) {
    case State::kSpin:
      command = spin(now);
      break;
    case State::kExplore:
      command = explore(now);
      break;
    case State::kLook:
      command = look(now);
      break;
    case State::kSweep:
      command = sweep(now);
      break;
    case State::kNavigate:
      command = navigate(now);
      break;
    case State::kVerify:
      command = verify(now);
      break;
    case State::kRecover:
      command = recover(now);
      break;
    case State::kStopped:
      break;
  }
  blocked_decisions_ =
      follower_.blocked() && state_ != State::kRecover ? blocked_decisions_ + 1 : 0;
  stuck_.add(now.pose, command);
  return command;
}

// ---- Maps and targets

bool SearchPolicy::replan_due(const Now& now) const {
  return !follower_.has_path() || replanned_ns_ == 0 ||
         core::seconds(now.time_ns - replanned_ns_) >= options_.replan_period_s - 1e-6;
}

void SearchPolicy::refresh_cost_map() {
  if (cost_fresh_) return;
  CostMapOptions options = options_.cost;
  if (effort_ != Effort::kNormal) {
    options.robot_radius_m = std::min(options_.tight_radius_m, options.robot_radius_m);
    options.margin_m = 0.0;
  }
  cost_.update(map_, on_map(cost_changed_), options);
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
  CostMapOptions options = options_.cost;
  options.robot_radius_m = std::min(options_.tight_radius_m, options.robot_radius_m);
  options.margin_m = 0.0;
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
  if (static_cast<int>(recoveries_) >= options_.max_recoveries) {
    stop(core::StopReason::kStuck);
    return;
  }
  const auto nearby = std::count_if(
      stuck_places_m_.begin(), stuck_places_m_.end(), [&](const glm::dvec2& place) {
        return glm::distance(place, now.position_m) < kSamePlace_m;
      });
  // Something is there that the camera does not show: VLFM lacks, SemExp has this "bump rule".
  if (stuck_.stuck() && nearby + 1 >= options_.recoveries_before_block) {
    const glm::dvec2 ahead(std::cos(now.pose.yaw_rad), std::sin(now.pose.yaw_rad));
    const double radius_m = 0.05 * static_cast<double>(nearby + 1);
    map_.mark_blocked_disc(
        now.position_m + (options_.occupancy.footprint_radius_m + 0.05) * ahead,
        std::min(radius_m, 0.2));
    note_map_changes();
    cost_fresh_ = false;
    refresh_cost_map();
  }
  stuck_places_m_.push_back(now.position_m);
  core::RandomStream random(seed_, "recovery", recoveries_);
  const double turn =
      random.uniform(options_.recover_turn_min_rad, options_.recover_turn_max_rad);
  recovery_yaw_rad_ = now.pose.yaw_rad + (random.chance(0.5) ? turn : -turn);
  if (state_ != State::kRecover) before_recovery_ = state_;
  state_ = State::kRecover;
  recovery_start_ = now.pose;
  recovery_since_ns_ = now.time_ns;
  recovery_turning_ = false;
  ++recoveries_;
  blocked_decisions_ = 0;
  stuck_.reset();
  follower_.clear();
}

core::VelocityCommand SearchPolicy::recover(const Now& now) {
  const double elapsed_s = core::seconds(now.time_ns - recovery_since_ns_);
  if (!recovery_turning_) {
    const double backed_m =
        std::hypot(now.pose.x_m - recovery_start_.x_m, now.pose.y_m - recovery_start_.y_m);
    const core::VelocityCommand back{-kBackSpeed_mps, 0.0};
    if (backed_m < options_.recover_back_m && elapsed_s < kRecoverPhase_s &&
        follower_.safe(now.pose, back, cost_)) {
      return back;
    }
    recovery_turning_ = true;
    recovery_since_ns_ = now.time_ns;
    return follower_.turn_to(now.pose, recovery_yaw_rad_, 0.15);
  }
  const core::VelocityCommand turn = follower_.turn_to(now.pose, recovery_yaw_rad_, 0.15);
  if (turn.turn_radps != 0.0 && elapsed_s < kRecoverPhase_s) return turn;
  state_ = before_recovery_ == State::kVerify ? State::kNavigate : before_recovery_;
  if (state_ == State::kLook) state_ = State::kExplore;
  replanned_ns_ = 0;
  stuck_.reset();
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
