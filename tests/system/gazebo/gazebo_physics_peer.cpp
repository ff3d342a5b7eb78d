// A second process that does to `segsim gazebo drive` what Gazebo with its physics does, on
// the same transport: it moves a robot by the velocities that it is sent, late and with slip,
// sends its poses as SceneBroadcaster would, and sets it down where the service asks.
//
//     gazebo_physics_peer world=NAME [key=value ...]
//
//     sdf=FILE        an exported world, in Gazebo's own physics engine; without: a point
//     whose
//                     wheels follow late and slip, and which drives through everything
//     fault=freeze | set_back | fall    after so many seconds since the robot was set down:
//     after=SECONDS
//     service=off                       no set_pose, as in a world without UserCommands
//
// Ends when it is killed. Says "moved N" for every time that it was set down.

#include <ignition/msgs/boolean.pb.h>
#include <ignition/msgs/pose.pb.h>
#include <ignition/msgs/pose_v.pb.h>
#include <ignition/msgs/twist.pb.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>

#include <ignition/transport/Node.hh>

#include "tests/system/gazebo/gazebo_dart.h"

namespace {

namespace msgs = ignition::msgs;
using Clock = std::chrono::steady_clock;
using segsim::tests::BodyPose;

constexpr double kStep_s = segsim::tests::DartWorld::kStep_s;

struct Settings {
  std::string world = "tiny", fault;
  std::string sdf;
  double after_s = 1.0;
  bool service = true;
};

Settings read_settings(int argc, char** argv) {
  Settings settings;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    const std::size_t equals = argument.find('=');
    const std::string key = argument.substr(0, equals), value = argument.substr(equals + 1);
    if (key == "world") settings.world = value;
    if (key == "sdf") settings.sdf = value;
    if (key == "fault") settings.fault = value;
    if (key == "after") settings.after_s = std::stod(value);
    if (key == "service") settings.service = value != "off";
  }
  return settings;
}

/// What moves the robot.
class Body {
 public:
  virtual ~Body() = default;
  virtual void set_down(double x_m, double y_m, double z_m, double yaw_rad) = 0;
  virtual void step(double forward_mps, double turn_radps) = 0;
  [[nodiscard]] virtual BodyPose pose() const = 0;
};

/// A base whose wheels follow commands with a delay, and which turns less than it is told.
class SlippingBody final : public Body {
 public:
  void set_down(double x_m, double y_m, double /*z_m*/, double yaw_rad) override {
    x_m_ = x_m;
    y_m_ = y_m;
    yaw_rad_ = yaw_rad;
    forward_mps_ = turn_radps_ = 0.0;
  }
  void step(double forward_mps, double turn_radps) override {
    forward_mps_ += (forward_mps - forward_mps_) * kStep_s / kLag_s;
    turn_radps_ += (kSlip * turn_radps - turn_radps_) * kStep_s / kLag_s;
    x_m_ += forward_mps_ * std::cos(yaw_rad_) * kStep_s;
    y_m_ += forward_mps_ * std::sin(yaw_rad_) * kStep_s;
    yaw_rad_ += turn_radps_ * kStep_s;
  }
  [[nodiscard]] BodyPose pose() const override {
    return {x_m_, y_m_, 0.03, std::cos(0.5 * yaw_rad_), 0.0, 0.0, std::sin(0.5 * yaw_rad_)};
  }

 private:
  static constexpr double kLag_s = 0.08, kSlip = 0.96;
  double x_m_ = -2.0, y_m_ = -1.0, yaw_rad_ = 0.0;
  double forward_mps_ = 0.0, turn_radps_ = 0.0;
};

#ifdef SEGSIM_DART_PLUGIN
class DartBody final : public Body {
 public:
  explicit DartBody(const std::string& sdf_file) : world_(sdf_file) {}
  void set_down(double x_m, double y_m, double z_m, double yaw_rad) override {
    world_.set_pose(x_m, y_m, z_m, yaw_rad);
  }
  void step(double forward_mps, double turn_radps) override {
    world_.step(forward_mps, turn_radps);
  }
  [[nodiscard]] BodyPose pose() const override { return world_.pose(); }

 private:
  segsim::tests::DartWorld world_;
};
#endif

std::unique_ptr<Body> make_body(const std::string& sdf_file) {
#ifdef SEGSIM_DART_PLUGIN
  if (!sdf_file.empty()) return std::make_unique<DartBody>(sdf_file);
#else
  if (!sdf_file.empty()) throw std::runtime_error("built without ignition-physics");
#endif
  return std::make_unique<SlippingBody>();
}

/// The world around the robot: its clock, its topics and its service.
class Physics {
 public:
  explicit Physics(Settings settings)
      : settings_(std::move(settings)), body_(make_body(settings_.sdf)) {
    poses_ = node_.Advertise<msgs::Pose_V>("/world/" + settings_.world + "/dynamic_pose/info");
    std::function<void(const msgs::Twist&)> obey = [this](const msgs::Twist& twist) {
      const std::lock_guard lock(mutex_);
      wanted_mps_ = twist.linear().x();
      wanted_radps_ = twist.angular().z();
    };
    node_.Subscribe("/model/jackal/cmd_vel", obey);
    if (!settings_.service) return;
    std::function<bool(const msgs::Pose&, msgs::Boolean&)> move =
        [this](const msgs::Pose& pose, msgs::Boolean& reply) {
          reply.set_data(pose.name() == "jackal");
          if (reply.data()) set_down(pose);
          return true;
        };
    node_.Advertise("/world/" + settings_.world + "/set_pose", move);
  }

  [[noreturn]] void run() {
    const auto start = Clock::now();
    for (std::int64_t step = 0;; ++step) {
      std::this_thread::sleep_until(start + std::chrono::nanoseconds(step * kStep_ns));
      const std::lock_guard lock(mutex_);
      const bool broken = moved_ > 0 && since_s_ > settings_.after_s;
      if (broken && settings_.fault == "freeze") continue;
      if (broken && settings_.fault == "set_back") {
        time_ns_ = 0;
        settings_.fault.clear();
      }
      body_->step(wanted_mps_, wanted_radps_);
      time_ns_ += kStep_ns;
      since_s_ += kStep_s;
      fallen_ = broken && settings_.fault == "fall";
      if (step % 2 == 0) send();
    }
  }

 private:
  static constexpr std::int64_t kStep_ns = 1'000'000'000 / 240;

  void set_down(const msgs::Pose& pose) {
    const std::lock_guard lock(mutex_);
    body_->set_down(pose.position().x(), pose.position().y(), pose.position().z(),
                    2.0 * std::atan2(pose.orientation().z(), pose.orientation().w()));
    since_s_ = 0.0;
    std::printf("moved %d\n", ++moved_);
    std::fflush(stdout);
  }

  void send() {
    msgs::Pose_V message;
    message.mutable_header()->mutable_stamp()->set_sec(time_ns_ / 1'000'000'000);
    message.mutable_header()->mutable_stamp()->set_nsec(
        static_cast<std::int32_t>(time_ns_ % 1'000'000'000));
    const BodyPose body = body_->pose();
    msgs::Pose* pose = message.add_pose();
    pose->set_name("jackal");
    pose->set_id(8);
    pose->mutable_position()->set_x(body.x_m);
    pose->mutable_position()->set_y(body.y_m);
    pose->mutable_position()->set_z(body.z_m);
    // On its side: a quarter turn about x.
    pose->mutable_orientation()->set_w(fallen_ ? std::sqrt(0.5) : body.qw);
    pose->mutable_orientation()->set_x(fallen_ ? std::sqrt(0.5) : body.qx);
    pose->mutable_orientation()->set_y(fallen_ ? 0.0 : body.qy);
    pose->mutable_orientation()->set_z(fallen_ ? 0.0 : body.qz);
    msgs::Pose* link = message.add_pose();
    link->set_name("base_link");
    link->set_id(9);
    link->mutable_orientation()->set_w(1.0);
    poses_.Publish(message);
  }

  Settings settings_;
  std::unique_ptr<Body> body_;
  std::mutex mutex_;
  bool fallen_ = false;
  double wanted_mps_ = 0.0, wanted_radps_ = 0.0;
  double since_s_ = 0.0;  ///< Since it was set down.
  std::int64_t time_ns_ = 5'000'000'000;
  int moved_ = 0;
  ignition::transport::Node node_;
  ignition::transport::Node::Publisher poses_;
};

}  // namespace

int main(int argc, char** argv) {
  try {
    Physics(read_settings(argc, argv)).run();
  } catch (const std::exception& error) {
    std::printf("%s\n", error.what());
    return 2;
  }
}
