#include "sim/gazebo/gazebo_drive.h"

#include <ignition/msgs/boolean.pb.h>
#include <ignition/msgs/pose.pb.h>
#include <ignition/msgs/twist.pb.h>

#include <cmath>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "core/error.h"
#include "core/formatted.h"
#include "core/interrupted.h"
#include "sim/gazebo/internal/gazebo_transport.h"
#include "sim/gazebo/internal/model_track.h"

namespace segsim::sim {
namespace {

namespace msgs = ignition::msgs;
using Clock = std::chrono::steady_clock;
using internal::Dialect;
using internal::ModelPose;
using internal::ModelTrack;
using internal::pose_between;

constexpr std::chrono::milliseconds kStep{50};  // Between two looks at `interrupted`.
constexpr double kNearStart_m = 0.10, kNearStart_rad = 0.10;
constexpr double kUpright = 0.5;  // Cosine: leaning by more than 60 degrees, it lies.
/// At rest: so little motion in so much of Gazebo's time.
constexpr double kStill_m = 0.002, kStill_rad = 0.005;
constexpr core::TimeNs kStillFor_ns = core::kNsPerSecond / 4;
constexpr double kDropped_m = 0.02;  // Set down from here, so that no wheel is in the floor.

bool near(const core::Pose2& a, const core::Pose2& b, double distance_m, double angle_rad) {
  return std::hypot(a.x_m - b.x_m, a.y_m - b.y_m) <= distance_m &&
         std::abs(core::wrap_angle_rad(a.yaw_rad - b.yaw_rad)) <= angle_rad;
}

/// Reads messages into the track. Callbacks hold it by shared pointer: one may still be under
/// way when the drive goes.
class Receiver {
 public:
  explicit Receiver(const std::string& model) : track(model) {}

  void receive(const char* bytes, std::size_t size) {
    const std::lock_guard lock(mutex_);
    if (message_.read(bytes, size)) {
      track.put(message_.stamp_ns(), message_.entities());
    } else {
      track.put_unreadable();
    }
  }

  ModelTrack track;

 private:
  std::mutex mutex_;
  internal::PoseMessage message_;
};

}  // namespace

struct GazeboDrive::Parts {
  explicit Parts(GazeboDriveOptions drive_options)
      : options(std::move(drive_options)),
        receiver(std::make_shared<Receiver>(options.model)),
        dialects(internal::make_dialects(options.flavour)) {
    if (options.pose_topic.empty()) {
      options.pose_topic = "/world/" + options.world + "/dynamic_pose/info";
    }
    if (options.command_topic.empty()) {
      options.command_topic = "/model/" + options.model + "/cmd_vel";
    }
    for (const auto& dialect : dialects) {
      wheels.push_back(
          dialect->node.Advertise(options.command_topic, dialect->prefix + "Twist"));
      if (!wheels.back()) refuse("a name of a topic", options.command_topic);
      const auto inbox = receiver;
      if (!dialect->node.SubscribeRaw(
              options.pose_topic,
              [inbox](const char* bytes, const std::size_t size,
                      const ignition::transport::MessageInfo&) {
                inbox->receive(bytes, size);
              },
              dialect->prefix + "Pose_V")) {
        refuse("a name of a topic", options.pose_topic);
      }
    }
  }

  [[noreturn]] void refuse(const std::string& expected, const std::string& found) const {
    throw core::InputError::expected("Gazebo, world " + options.world, expected, found);
  }

  [[nodiscard]] ModelTrack& track() const { return receiver->track; }

  /// Calls `look` until it returns something. @param expected  Told if it never does.
  template <class Look>
  auto await(const Look& look, const std::string& expected) const {
    const auto end = Clock::now() + std::chrono::duration<double>(options.patience_s);
    while (true) {
      if (options.interrupted && options.interrupted()) {
        throw core::Interrupted("stopped by a signal while waiting for Gazebo");
      }
      if (auto found = look()) return *found;
      if (Clock::now() < end) continue;
      const std::string fault = track().last_fault();
      refuse(expected + core::print(" within %g s", options.patience_s),
             fault.empty() ? "none" : fault);
    }
  }

  ModelPose await_newer(core::TimeNs after_ns) const {
    return await([&] { return track().wait_newer(after_ns, kStep); },
                 "poses of '" + options.model + "' on " + options.pose_topic);
  }

  /// The pose after the one that the trial has come to.
  [[nodiscard]] ModelPose await_ahead() const {
    const auto look = [&] {
      if (track().restarts() != restarts) {
        refuse("a clock that goes on", "one that was set back during a trial");
      }
      return track().take(here.stamp_ns, kStep);
    };
    const ModelPose pose =
        await(look, "poses of '" + options.model + "' on " + options.pose_topic);
    if (pose.upright < kUpright) {
      refuse("'" + options.model + "' on its wheels", "one that fell over");
    }
    return pose;
  }

  /// Until the robot has not moved for a while.
  ModelPose await_rest() const {
    ModelPose since = await_newer(-1);
    return await(
        [&]() -> std::optional<ModelPose> {
          const auto pose = track().wait_newer(since.stamp_ns, kStep);
          if (!pose) return {};
          if (pose->stamp_ns < since.stamp_ns ||
              !near(pose->pose, since.pose, kStill_m, kStill_rad)) {
            since = *pose;
          }
          return pose->stamp_ns - since.stamp_ns >= kStillFor_ns ? pose : std::nullopt;
        },
        "'" + options.model + "' to come to rest");
  }

  /// Has Gazebo set the robot down there.
  void set_pose(const core::Pose2& place, double height_m) const {
    msgs::Pose request;
    request.set_name(options.model);
    request.mutable_position()->set_x(place.x_m);
    request.mutable_position()->set_y(place.y_m);
    request.mutable_position()->set_z(height_m + kDropped_m);
    request.mutable_orientation()->set_w(std::cos(0.5 * place.yaw_rad));
    request.mutable_orientation()->set_z(std::sin(0.5 * place.yaw_rad));
    const std::string service = "/world/" + options.world + "/set_pose";
    const auto ask = [&]() -> std::optional<bool> {
      msgs::Boolean reply;
      bool done = false;
      constexpr unsigned kAnswer_ms = 1000;
      // Only the first dialect has services: types of requests cannot be renamed.
      if (!dialects.front()->node.Request(service, request, kAnswer_ms, reply, done))
        return {};
      return done && reply.data();
    };
    if (!await(ask, "an answer of the service " + service + " (system UserCommands)")) {
      refuse("the service " + service + " to move '" + options.model + "'", "a refusal");
    }
  }

  void send(const core::VelocityCommand& command) {
    msgs::Twist twist;
    twist.mutable_linear()->set_x(command.forward_mps);
    twist.mutable_angular()->set_z(command.turn_radps);
    for (std::size_t i = 0; i < wheels.size(); ++i) {
      if (wheels[i].HasConnections()) {
        wheels[i].PublishRaw(twist.SerializeAsString(), dialects[i]->prefix + "Twist");
      }
    }
  }

  [[nodiscard]] bool heard() const {
    for (const auto& wheel : wheels) {
      if (wheel.HasConnections()) return true;
    }
    return false;
  }

  /// Time and place that the trial has come to, in Gazebo's time.
  ModelPose here;
  std::optional<ModelPose> ahead;        ///< Taken from the track, but not reached.
  std::optional<core::TimeNs> start_ns;  ///< Of the trial.
  std::uint64_t restarts = 0;            ///< Of the track when the trial began.

  GazeboDriveOptions options;
  std::shared_ptr<Receiver> receiver;
  std::vector<std::unique_ptr<Dialect>> dialects;
  std::vector<ignition::transport::Node::Publisher> wheels;  ///< In the dialects' order.
};

GazeboDrive::GazeboDrive(GazeboDriveOptions options)
    : parts_(std::make_unique<Parts>(std::move(options))) {}

GazeboDrive::~GazeboDrive() = default;

void GazeboDrive::await_poses() { (void)parts_->await_newer(-1); }

core::Pose2 GazeboDrive::begin(const core::Pose2& start) {
  Parts& parts = *parts_;
  parts.start_ns.reset();
  parts.ahead.reset();
  parts.await(
      [&]() -> std::optional<bool> {
        if (parts.heard()) return true;
        std::this_thread::sleep_for(kStep);
        return {};
      },
      "a subscriber of " + parts.options.command_topic);
  parts.send({});
  const ModelPose before = parts.await_rest();
  parts.set_pose(start, before.height_m);
  parts.await(
      [&]() -> std::optional<bool> {
        const auto pose = parts.track().wait_newer(before.stamp_ns, kStep);
        if (pose && near(pose->pose, start, kNearStart_m, kNearStart_rad)) return true;
        return {};
      },
      "'" + parts.options.model + "' at the start of the episode");
  parts.here = parts.await_rest();
  if (!near(parts.here.pose, start, kNearStart_m, kNearStart_rad)) {
    parts.refuse("'" + parts.options.model + "' to stay where it was set down",
                 core::print("%.2f, %.2f m", parts.here.pose.x_m, parts.here.pose.y_m));
  }
  parts.restarts = parts.track().restarts();
  return parts.here.pose;
}

void GazeboDrive::command(const core::VelocityCommand& command) {
  Parts& parts = *parts_;
  const auto newest = parts.track().newest();
  if (newest && parts.start_ns) {
    const double lag_s = core::seconds(newest->stamp_ns - parts.here.stamp_ns);
    if (lag_s > parts.options.most_lag_s) {
      parts.refuse(core::print("commands at most %g s behind its clock (smaller images, or a "
                               "longer control period, take less time)",
                               parts.options.most_lag_s),
                   core::print("%.2f s", lag_s));
    }
  }
  parts.send(command);
}

void GazeboDrive::end() noexcept {
  try {
    parts_->send({});
  } catch (const std::exception&) {  // Nobody is left who could be told.
  }
}

ExternalDrive::Moment GazeboDrive::next(core::TimeNs until_ns) {
  Parts& parts = *parts_;
  if (!parts.start_ns) {
    if (const auto newest = parts.track().newest()) parts.here = *newest;
    parts.start_ns = parts.here.stamp_ns;
    return {0, parts.here.pose};
  }
  if (!parts.ahead) parts.ahead = parts.await_ahead();
  const core::TimeNs stamp_ns = *parts.start_ns + until_ns;
  if (parts.ahead->stamp_ns <= stamp_ns) {
    parts.here = *std::exchange(parts.ahead, std::nullopt);
  } else {
    parts.here.pose = pose_between(parts.here, *parts.ahead, stamp_ns);
    parts.here.stamp_ns = stamp_ns;
  }
  return {parts.here.stamp_ns - *parts.start_ns, parts.here.pose};
}

}  // namespace segsim::sim
