#include "sim/trial/internal/trial_drive.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include <glm/geometric.hpp>

#include "core/check.h"
#include "core/error.h"

namespace segsim::sim::internal {
namespace {

constexpr core::TimeNs kContactDebounce_ns = core::kNsPerSecond / 2;
/// Another simulator's robot touches what is this near: half a cell of the grid.
constexpr double kTouch_m = 0.01;
/// A contact point lies on the 2 cm grid of the collision world, boxes fit the surface.
constexpr double kBoxMargin_m = 0.05;

std::uint16_t instance_at(const core::SceneManifest& manifest, const glm::dvec2& p_m) {
  for (const core::SceneInstance& instance : manifest.instances) {
    if (p_m.x >= instance.box_min_m.x - kBoxMargin_m &&
        p_m.x <= instance.box_max_m.x + kBoxMargin_m &&
        p_m.y >= instance.box_min_m.y - kBoxMargin_m &&
        p_m.y <= instance.box_max_m.y + kBoxMargin_m) {
      return instance.id;
    }
  }
  return 0;
}

}  // namespace

TrialDrive::TrialDrive(const Episode& episode, const TrialOptions& options, const World& world,
                       const RobotModel& robot, ExternalDrive* external)
    : options_(options),
      world_(world),
      external_(external),
      robot_(robot, episode.start),
      substep_ns_(std::llround(options.substep_s * 1e9)) {
  const core::TimeNs period_ns = std::llround(options.control_period_s * 1e9);
  SEGSIM_CHECK(substep_ns_ > 0 && period_ns > 0 && period_ns % substep_ns_ == 0,
               "the control period is a whole number of substeps");
  SEGSIM_CHECK(external_ == nullptr || options.clock.mode == ClockMode::kRealtime,
               "another simulator does not wait");
  place(episode);
  const core::Pose2 start = external_ != nullptr ? pose() : episode.start;
  SEGSIM_CHECK(!options.odometry || !options.localiser, "one kind of localisation");
  if (options.odometry) odometer_.emplace(*options.odometry, start, episode.seed);
  if (options.localiser) {
    localiser_.emplace(*options.localiser, episode.seed);
    localiser_->move_to(0, start);
  }
  if (options.sensors) {
    sensors_.emplace(*options.sensors, world_.mesh(), world_.local_frame(), start,
                     episode.seed);
  }
}

void TrialDrive::place(const Episode& episode) {
  const std::string place = "episode " + episode.id;
  if (options_.collision == CollisionMode::kNavmesh) {
    const glm::dvec3 start_m(episode.start.x_m, episode.start.y_m, 0.0);
    walker_ = NavmeshWalker::place(world_.navmesh(), start_m);
    if (!walker_) {
      throw core::InputError::expected(place, "a start on the navigation mesh",
                                       "none near it");
    }
    const glm::dvec3& p_m = walker_->position_m();
    robot_.set_pose({p_m.x, p_m.y, episode.start.yaw_rad});
  } else if (world_.collision().collides(episode.start)) {
    throw core::InputError::expected(place, "a free start", "a collision");
  }
  if (external_ != nullptr) robot_.set_pose(external_->begin(episode.start));
}

void TrialDrive::set_command(const core::VelocityCommand& command) {
  command_ = command;
  if (external_ != nullptr) return external_->command(command);
  robot_.set_command(command);
}

bool TrialDrive::drive_to(core::TimeNs time_ns) {
  if (external_ != nullptr) return follow_to(time_ns);
  while (now_ns_ < time_ns) {
    // Steps lie on one grid, so that a command between two of them does not shift the others.
    const core::TimeNs next_ns = std::min(time_ns, (now_ns_ / substep_ns_ + 1) * substep_ns_);
    const core::TimeNs step_ns = next_ns - now_ns_;
    const double step_s = step_ns == substep_ns_ ? options_.substep_s : core::seconds(step_ns);
    const core::VelocityCommand velocity = robot_.update_velocity(step_s);
    const MoveResult moved = move(velocity, step_s);
    arrive(next_ns, moved.pose);
    if (moved.contact) {
      // A base that slides keeps its wheels turning.
      if (options_.contact_response == ContactResponse::kStop) robot_.set_velocity({});
      note_contact(*moved.contact, step_ns);
      if (options_.stop_on_contact) return false;
    }
  }
  return true;
}

bool TrialDrive::follow_to(core::TimeNs time_ns) {
  while (!following_ || now_ns_ < time_ns) {
    following_ = true;
    const core::TimeNs before_ns = now_ns_;
    const core::Pose2 before = pose();
    const ExternalDrive::Moment moment = external_->next(time_ns);
    const core::TimeNs step_ns = moment.time_ns - before_ns;
    if (step_ns == 0) {  // The first one.
      robot_.set_pose(moment.pose);
      continue;
    }
    arrive(moment.time_ns, moment.pose);
    const double step_s = core::seconds(step_ns);
    const glm::dvec2 moved_m(pose().x_m - before.x_m, pose().y_m - before.y_m);
    const glm::dvec2 ahead(std::cos(before.yaw_rad), std::sin(before.yaw_rad));
    const double turned_rad = core::wrap_angle_rad(pose().yaw_rad - before.yaw_rad);
    robot_.set_velocity({glm::dot(moved_m, ahead) / step_s, turned_rad / step_s});
    const Clearance clearance = world_.collision().clearance(pose());
    if (clearance.distance_m > kTouch_m) continue;
    const double approach_mps = std::max(0.0, -glm::dot(moved_m, clearance.normal)) / step_s;
    note_contact({clearance.point_m, clearance.normal, approach_mps}, step_ns);
    if (options_.stop_on_contact) return false;
  }
  return true;
}

void TrialDrive::arrive(core::TimeNs time_ns, const core::Pose2& pose) {
  const core::Pose2& before = robot_.state().pose;
  path_m_ += std::hypot(pose.x_m - before.x_m, pose.y_m - before.y_m);
  robot_.set_pose(pose);
  now_ns_ = time_ns;
  if (odometer_) odometer_->move_to(now_ns_, pose);
  if (localiser_) localiser_->move_to(now_ns_, pose);
  if (sensors_) sensors_->move_to(now_ns_, pose);
}

MoveResult TrialDrive::move(const core::VelocityCommand& velocity, double step_s) {
  const core::Pose2& from = robot_.state().pose;
  if (!walker_) {
    const bool repeated =
        moved_ && moved_->from.x_m == from.x_m && moved_->from.y_m == from.y_m &&
        moved_->from.yaw_rad == from.yaw_rad &&
        moved_->velocity.forward_mps == velocity.forward_mps &&
        moved_->velocity.turn_radps == velocity.turn_radps && moved_->step_s == step_s;
    if (!repeated) {
      moved_ =
          Moved{from, velocity, step_s,
                world_.collision().move(from, velocity, step_s, options_.contact_response)};
    }
    return moved_->result;
  }
  const core::Pose2 wanted = drive_arc(from, velocity, step_s);
  const NavmeshWalker::Step step =
      walker_->walk({wanted.x_m, wanted.y_m}, options_.contact_response);
  MoveResult result;
  result.pose = {step.position_m.x, step.position_m.y, wanted.yaw_rad};
  if (step.wall_normal) {
    const glm::dvec2 motion_m(wanted.x_m - from.x_m, wanted.y_m - from.y_m);
    const double approach_m = -glm::dot(motion_m, *step.wall_normal);
    result.contact = Contact{glm::dvec2(step.position_m), *step.wall_normal,
                             std::max(0.0, approach_m) / step_s};
  }
  return result;
}

void TrialDrive::note_contact(const Contact& contact, core::TimeNs step_ns) {
  in_contact_ = true;
  contact_ns_ += step_ns;
  if (last_contact_ns_ < 0 || now_ns_ - last_contact_ns_ > kContactDebounce_ns) {
    contacts_.push_back({now_ns_, contact.point_m, contact.normal, contact.approach_mps, 0.0,
                         instance_at(world_.manifest(), contact.point_m)});
  }
  contacts_.back().duration_s += core::seconds(step_ns);
  last_contact_ns_ = now_ns_;
}

void TrialDrive::report(TrialResult& result) {
  result.final_pose = pose();
  result.final_estimate = estimate();
  result.sim_s = core::seconds(now_ns_);
  result.path_m = path_m();
  result.contact_s = core::seconds(contact_ns_);
  result.contacts = contacts();
  result.contact_log = std::move(contacts_);
  if (sensors_) result.sensors = sensors_->take_log();
}

}  // namespace segsim::sim::internal
