#include <algorithm>
#include <cmath>
#include <numbers>

#include <glm/geometric.hpp>

#include "core/check.h"
#include "nav/internal/robot_pose.h"
#include "nav/internal/search_policy.h"

namespace segsim::nav::internal {
namespace {

constexpr double kSameTarget_m = 0.5;   // A target that moved less is the same one.
constexpr double kProgress_m = 0.3;     // Coming nearer by this much is progress.
constexpr double kAtFrontier_m = 0.35;  // A frontier this near to a looked-at one is the same.
constexpr double kSamePlace_m = 0.5;    // Recoveries this near to one another count together.
constexpr int kBlockedLimit = 15;       // Decisions without a safe forward motion.
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
    if (map_.exhausted()) stop("map_exhausted");
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
    decision.stop = true;
    decision.stop_reason = stop_reason_;
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

// ---- Looking around

void SearchPolicy::begin_spin(const Now& now) {
  state_ = State::kSpin;
  spun_rad_ = 0.0;
  last_yaw_rad_ = now.pose.yaw_rad;
  replanned_ns_ = now.time_ns;
  follower_.clear();
  stuck_.reset();
}

core::VelocityCommand SearchPolicy::spin(const Now& now) {
  spun_rad_ += core::wrap_angle_rad(now.pose.yaw_rad - last_yaw_rad_);
  if (spun_rad_ >= options_.spin_angle_rad - 0.05) {
    state_ = sweep_places_m_.empty() ? State::kExplore : State::kSweep;
    replanned_ns_ = 0;
    target_.reset();
    return {};
  }
  return {0.0, std::min(options_.spin_rate_radps, options_.follower.max_turn_radps)};
}

core::VelocityCommand SearchPolicy::look(const Now& now) {
  const bool all_around = target_->outward == glm::dvec2(0.0);
  const double yaw_rad =
      all_around ? now.pose.yaw_rad : std::atan2(target_->outward.y, target_->outward.x);
  const core::VelocityCommand command = follower_.turn_to(now.pose, yaw_rad, 0.15);
  const bool late = core::seconds(now.time_ns - target_->since_ns) > options_.target_timeout_s;
  if (command.turn_radps != 0.0 && !late) return command;
  if (target_->bold) {
    selector_.blacklist(target_->position_m);
  } else {
    looked_at_m_ = target_->position_m;
  }
  target_.reset();
  state_ = State::kExplore;
  replanned_ns_ = 0;
  return {};
}

core::VelocityCommand SearchPolicy::sweep(const Now& now) {
  if (replan_due(now)) {
    replanned_ns_ = now.time_ns;
    while (!sweep_places_m_.empty() && !drive_to(now, sweep_places_m_.back())) {
      sweep_places_m_.pop_back();
    }
    if (sweep_places_m_.empty()) {
      state_ = State::kExplore;
      replanned_ns_ = 0;
      return {};
    }
    track_target(now, sweep_places_m_.back(), glm::dvec2(0.0));
  }
  if (hopeless(now) || follower_.arrived(now.pose)) {
    const bool arrived = follower_.arrived(now.pose);
    sweep_places_m_.pop_back();
    target_.reset();
    replanned_ns_ = 0;
    if (arrived) {
      begin_spin(now);
    } else if (sweep_places_m_.empty()) {
      state_ = State::kExplore;
    }
    return {};
  }
  return follower_.follow(now.pose, cost_);
}

// ---- Exploring

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

bool SearchPolicy::replan_explore(const Now& now) {
  replanned_ns_ = now.time_ns;
  const bool known = field_.begin(cost_, cost_.frame().cell_at(now.position_m));
  const bool bold = effort_ == Effort::kBold || effort_ == Effort::kBoldAgain;
  FrontierOptions options = options_.frontiers;
  if (effort_ != Effort::kNormal) options.min_length_m = 0.0;
  frontiers_ =
      known ? find_reachable_frontiers(cost_, field_, options) : std::vector<Frontier>{};
  while (true) {
    const std::optional<Frontier> frontier = selector_.select(frontiers_, field_);
    if (!frontier) return bold && replan_bold(now);
    const bool seen_it_all =
        looked_at_m_ && glm::distance(*looked_at_m_, frontier->waypoint_m) <= kAtFrontier_m;
    if (!seen_it_all && drive_to(now, frontier->waypoint_m)) {
      track_target(now, frontier->waypoint_m, frontier->outward);
      return true;
    }
    // Looked at from its very edge, or no way there: not worth another try.
    selector_.blacklist(frontier->waypoint_m);
  }
}

bool SearchPolicy::replan_bold(const Now& now) {
  build_bold_map();
  const GridFrame& frame = bold_.frame();
  if (!field_.begin(bold_, frame.cell_at(now.position_m))) return false;
  const CellBox part = bold_.active();
  core::Image<std::uint8_t> known(part.width(), part.height());
  for (int j = 0; j < part.height(); ++j) {
    const CellState* states = bold_.states().row(j + part.low.y) + part.low.x;
    for (int i = 0; i < part.width(); ++i) {
      known(i, j) = states[i] != CellState::kUnknown ? 1 : 0;
    }
  }
  const core::Image<float> depth_m = distance_to_cells_m(known, frame.resolution_m);
  if (target_ && target_->bold) {  // Stay with it while it is worth it.
    const Cell cell = frame.cell_at(target_->position_m);
    if (bold_.state(cell) == CellState::kUnknown && field_.reachable(cell) &&
        drive_to(now, target_->position_m, bold_)) {
      track_target(now, target_->position_m, glm::dvec2(0.0));
      return true;
    }
  }
  std::optional<Cell> best;
  for (int j = part.low.y; j <= part.high.y; ++j) {
    for (int i = part.low.x; i <= part.high.x; ++i) {
      const float in_m = depth_m(i - part.low.x, j - part.low.y);
      if (static_cast<double>(in_m) < options_.bold_depth_m || !field_.reachable({i, j})) {
        continue;
      }
      const float cost_m = field_.cost_m(i, j);
      if ((best && cost_m >= field_.cost_m(best->x, best->y)) ||
          selector_.blacklisted(frame.center_m({i, j}))) {
        continue;
      }
      best = Cell(i, j);
    }
  }
  if (!best || !drive_to(now, frame.center_m(*best), bold_)) return false;
  track_target(now, frame.center_m(*best), glm::dvec2(0.0));
  target_->bold = true;
  return true;
}

core::VelocityCommand SearchPolicy::explore(const Now& now) {
  if (replan_due(now)) {
    if (!replan_explore(now)) {
      follower_.clear();
      target_.reset();
      escalate(now);
      return {};
    }
  }
  if (hopeless(now)) {
    selector_.blacklist(target_->position_m);
    target_.reset();
    replanned_ns_ = 0;
    return {};
  }
  if (follower_.arrived(now.pose)) {
    state_ = State::kLook;
    return look(now);
  }
  return follower_.follow(now.pose, cost_);
}

void SearchPolicy::escalate(const Now& now) {
  if (const MappedObject* object = best_tentative(now)) {
    begin_navigate(now, object->id);
    return;
  }
  if (effort_ == Effort::kBoldAgain) {
    stop("no_frontier_left");
    return;
  }
  effort_ = static_cast<Effort>(static_cast<int>(effort_) + 1);
  cost_fresh_ = false;
  replanned_ns_ = 0;
  selector_.clear_blacklist();
  looked_at_m_.reset();
  if (effort_ == Effort::kSweep) {
    if (field_.begin(cost_, cost_.frame().cell_at(now.position_m))) {
      sweep_places_m_ = spread_places(cost_, field_, options_.sweep_places);
      std::reverse(sweep_places_m_.begin(), sweep_places_m_.end());
    }
    if (!sweep_places_m_.empty()) state_ = State::kSweep;
  }
}

void SearchPolicy::stop(const std::string& reason) {
  state_ = State::kStopped;
  stop_reason_ = reason;
  follower_.clear();
}

// ---- Recovering

void SearchPolicy::begin_recovery(const Now& now) {
  if (static_cast<int>(recoveries_) >= options_.max_recoveries) {
    stop("stuck");
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
        {glm::dvec2(object.center_m), goal_.class_index, object.best_score});
  }
  return view;
}

}  // namespace segsim::nav::internal
