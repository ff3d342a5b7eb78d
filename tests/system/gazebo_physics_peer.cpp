// A second process that does to `segsim gazebo drive` what Gazebo with its physics does, on
// the same transport: it moves a robot by the velocities that it is sent, late and with slip,
// sends its poses as SceneBroadcaster would, and sets it down where the service asks.
//
//     gazebo_physics_peer world=NAME [key=value ...]
//
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
#include <mutex>
#include <string>
#include <thread>

#include <ignition/transport/Node.hh>

namespace {

namespace msgs = ignition::msgs;
using Clock = std::chrono::steady_clock;

struct Settings {
  std::string world = "tiny", fault;
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
    if (key == "fault") settings.fault = value;
    if (key == "after") settings.after_s = std::stod(value);
    if (key == "service") settings.service = value != "off";
  }
  return settings;
}

/// A base whose wheels follow commands with a delay, and which turns less than it is told.
class Physics {
 public:
  explicit Physics(Settings settings) : settings_(std::move(settings)) {
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
      if (broken && settings_.fault == "fall") roll_rad_ = 1.5;
      advance();
      if (step % 2 == 0) send();
    }
  }

 private:
  static constexpr std::int64_t kStep_ns = 1'000'000'000 / 240;
  static constexpr double kStep_s = 1.0 / 240.0, kLag_s = 0.08, kSlip = 0.96;

  void set_down(const msgs::Pose& pose) {
    const std::lock_guard lock(mutex_);
    x_m_ = pose.position().x();
    y_m_ = pose.position().y();
    yaw_rad_ = 2.0 * std::atan2(pose.orientation().z(), pose.orientation().w());
    forward_mps_ = turn_radps_ = since_s_ = 0.0;
    std::printf("moved %d\n", ++moved_);
    std::fflush(stdout);
  }

  void advance() {
    forward_mps_ += (wanted_mps_ - forward_mps_) * kStep_s / kLag_s;
    turn_radps_ += (kSlip * wanted_radps_ - turn_radps_) * kStep_s / kLag_s;
    x_m_ += forward_mps_ * std::cos(yaw_rad_) * kStep_s;
    y_m_ += forward_mps_ * std::sin(yaw_rad_) * kStep_s;
    yaw_rad_ += turn_radps_ * kStep_s;
    time_ns_ += kStep_ns;
    since_s_ += kStep_s;
  }

  void send() {
    msgs::Pose_V message;
    message.mutable_header()->mutable_stamp()->set_sec(time_ns_ / 1'000'000'000);
    message.mutable_header()->mutable_stamp()->set_nsec(
        static_cast<std::int32_t>(time_ns_ % 1'000'000'000));
    msgs::Pose* pose = message.add_pose();
    pose->set_name("jackal");
    pose->set_id(8);
    pose->mutable_position()->set_x(x_m_);
    pose->mutable_position()->set_y(y_m_);
    pose->mutable_position()->set_z(0.03);
    // Yaw, then roll.
    const double cy = std::cos(0.5 * yaw_rad_), sy = std::sin(0.5 * yaw_rad_);
    const double cr = std::cos(0.5 * roll_rad_), sr = std::sin(0.5 * roll_rad_);
    pose->mutable_orientation()->set_w(cy * cr);
    pose->mutable_orientation()->set_x(cy * sr);
    pose->mutable_orientation()->set_y(sy * sr);
    pose->mutable_orientation()->set_z(sy * cr);
    msgs::Pose* link = message.add_pose();
    link->set_name("base_link");
    link->set_id(9);
    link->mutable_orientation()->set_w(1.0);
    poses_.Publish(message);
  }

  Settings settings_;
  std::mutex mutex_;
  double x_m_ = -2.0, y_m_ = -1.0, yaw_rad_ = 0.0, roll_rad_ = 0.0;
  double forward_mps_ = 0.0, turn_radps_ = 0.0, wanted_mps_ = 0.0, wanted_radps_ = 0.0;
  double since_s_ = 0.0;  ///< Since it was set down.
  std::int64_t time_ns_ = 5'000'000'000;
  int moved_ = 0;
  ignition::transport::Node node_;
  ignition::transport::Node::Publisher poses_;
};

}  // namespace

int main(int argc, char** argv) { Physics(read_settings(argc, argv)).run(); }
