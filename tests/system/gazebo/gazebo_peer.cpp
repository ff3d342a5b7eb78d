// A second process that does to the bridge what Gazebo does, on the same transport: sends the
// poses of a recorded drive as SceneBroadcaster would, and receives images as any subscriber.
//
//     gazebo_peer drive=FILE world=NAME [key=value ...]
//
// Prints one "name value" a line. See Settings for the keys.

#include <ignition/msgs/camera_info.pb.h>
#include <ignition/msgs/image.pb.h>
#include <ignition/msgs/pose_v.pb.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <map>
#include <mutex>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <ignition/transport/Node.hh>

namespace {

namespace msgs = ignition::msgs;
using Clock = std::chrono::steady_clock;

struct Settings {
  std::string drive;                      // Lines "x y yaw", one for each pose.
  std::string world = "tiny";             // In the topic of poses.
  double rate_hz = 60.0;                  // Of poses, in wall and simulated time.
  int frames = 60;                        // Poses to send after the first image came.
  std::string prefix = "ignition.msgs.";  // Of message types.
  std::vector<std::string> images;        // Topics to wait for; a frame is complete with all.
  std::string info;                       // Topic of camera info; empty = not subscribed.
  std::string fault;                      // nan | quaternion | entity | stamp | garbage
  int fault_every = 0;                    // Every n-th pose is like that.
  std::string dump;                       // Folder for the last complete frame.
  std::string advertise;                  // Topic of images that it claims to publish as well.
  double patience_s = 20.0;               // For the first image.
};

Settings read_settings(int argc, char** argv) {
  Settings settings;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    const std::size_t equals = argument.find('=');
    const std::string key = argument.substr(0, equals), value = argument.substr(equals + 1);
    if (key == "drive") settings.drive = value;
    if (key == "world") settings.world = value;
    if (key == "rate") settings.rate_hz = std::stod(value);
    if (key == "frames") settings.frames = std::stoi(value);
    if (key == "prefix") settings.prefix = value;
    if (key == "image") settings.images.push_back(value);
    if (key == "info") settings.info = value;
    if (key == "fault") settings.fault = value;
    if (key == "fault_every") settings.fault_every = std::stoi(value);
    if (key == "dump") settings.dump = value;
    if (key == "advertise") settings.advertise = value;
    if (key == "patience") settings.patience_s = std::stod(value);
  }
  return settings;
}

struct Place {
  double x_m = 0.0, y_m = 0.0, yaw_rad = 0.0;
};

std::vector<Place> read_drive(const std::string& file) {
  std::ifstream in(file);
  std::vector<Place> places;
  for (Place place; in >> place.x_m >> place.y_m >> place.yaw_rad;) places.push_back(place);
  return places;
}

/// What came back for each simulated time.
class Receiver {
 public:
  explicit Receiver(std::size_t streams)
      : streams_(streams), newest_(streams, -1), last_(streams) {}

  void sent(std::int64_t stamp_ns) {
    const std::lock_guard lock(mutex_);
    sent_[stamp_ns] = Clock::now();
    // Bounded: whatever is not answered within 10 000 poses never is.
    if (sent_.size() > 10000) sent_.erase(sent_.begin());
  }

  void received(std::size_t stream, const char* bytes, std::size_t size) {
    const auto now = Clock::now();
    msgs::Image image;
    if (!image.ParseFromArray(bytes, static_cast<int>(size))) return;
    const std::lock_guard lock(mutex_);
    const std::int64_t stamp_ns =
        image.header().stamp().sec() * 1'000'000'000 + image.header().stamp().nsec();
    if (image.data().size() != image.step() * image.height()) ++odd_sizes_;
    if (stamp_ns <= newest_[stream]) ++out_of_order_;
    newest_[stream] = stamp_ns;
    auto& arrived = arrived_[stamp_ns];
    arrived |= 1U << stream;
    last_[stream] = std::move(image);
    if (arrived != (1U << streams_) - 1U) return;
    arrived_.erase(arrived_.begin(), arrived_.upper_bound(stamp_ns));
    const auto start = sent_.find(stamp_ns);
    if (start == sent_.end()) return;
    ++complete_;
    complete_stamp_ns_ = stamp_ns;
    if (measuring_) {
      latencies_ms_.push_back(
          std::chrono::duration<double, std::milli>(now - start->second).count());
    }
  }

  void received_info(const msgs::CameraInfo& info) {
    const std::lock_guard lock(mutex_);
    ++infos_;
    info_ = info;
  }

  [[nodiscard]] int complete() {
    const std::lock_guard lock(mutex_);
    return complete_;
  }
  /// From here on it counts.
  void measure() {
    const std::lock_guard lock(mutex_);
    measuring_ = true;
    complete_ = 0;
    sent_.clear();  // Answers under way are of the search for each other.
  }

  void report(int sent, double elapsed_s) {
    const std::lock_guard lock(mutex_);
    std::printf(
        "sent %d\ncomplete %d\nelapsed_s %.3f\nodd_sizes %d\nout_of_order %d\ninfos %d\n",
        sent, complete_, elapsed_s, odd_sizes_, out_of_order_, infos_);
    std::sort(latencies_ms_.begin(), latencies_ms_.end());
    const auto quantile = [this](double share) {
      if (latencies_ms_.empty()) return 0.0;
      return latencies_ms_[static_cast<std::size_t>(
          share * static_cast<double>(latencies_ms_.size() - 1))];
    };
    std::printf(
        "latency_p50_ms %.3f\nlatency_p95_ms %.3f\nlatency_p99_ms %.3f\n"
        "latency_max_ms %.3f\n",
        quantile(0.5), quantile(0.95), quantile(0.99), quantile(1.0));
    if (infos_ > 0) {
      std::printf("info_width %u\ninfo_fx %.17g\ninfo_cx %.17g\n", info_.width(),
                  info_.intrinsics().k(0), info_.intrinsics().k(2));
    }
  }

  /// The last frame's images as raw bytes 0.bin, 1.bin, ... and their headers.
  void dump(const std::string& folder) {
    const std::lock_guard lock(mutex_);
    for (std::size_t i = 0; i < streams_; ++i) {
      const msgs::Image& image = last_[i];
      std::ofstream(folder + "/" + std::to_string(i) + ".bin", std::ios::binary)
          << image.data();
      std::ofstream header(folder + "/" + std::to_string(i) + ".txt");
      header << image.width() << " " << image.height() << " " << image.step() << " "
             << msgs::PixelFormatType_Name(image.pixel_format_type()) << " "
             << image.header().stamp().sec() * 1'000'000'000 + image.header().stamp().nsec();
      for (const auto& entry : image.header().data()) {
        if (entry.key() == "frame_id") header << " " << entry.value(0);
      }
      header << "\n";
    }
  }

 private:
  std::mutex mutex_;
  std::size_t streams_;
  std::map<std::int64_t, Clock::time_point> sent_;
  std::map<std::int64_t, unsigned> arrived_;
  std::vector<std::int64_t> newest_;
  std::vector<msgs::Image> last_;
  std::vector<double> latencies_ms_;
  msgs::CameraInfo info_;
  std::int64_t complete_stamp_ns_ = -1;
  int complete_ = 0, odd_sizes_ = 0, out_of_order_ = 0, infos_ = 0;
  bool measuring_ = false;
};

void add(msgs::Pose_V& message, const char* name, unsigned id, double x_m, double y_m,
         double z_m, double yaw_rad) {
  msgs::Pose* pose = message.add_pose();
  pose->set_name(name);
  pose->set_id(id);
  pose->mutable_position()->set_x(x_m);
  pose->mutable_position()->set_y(y_m);
  pose->mutable_position()->set_z(z_m);
  pose->mutable_orientation()->set_w(std::cos(0.5 * yaw_rad));
  pose->mutable_orientation()->set_z(std::sin(0.5 * yaw_rad));
}

/// The robot and a crate whose link has the same name, in Gazebo's order.
msgs::Pose_V message_at(const Place& place, std::int64_t stamp_ns) {
  msgs::Pose_V message;
  message.mutable_header()->mutable_stamp()->set_sec(stamp_ns / 1'000'000'000);
  message.mutable_header()->mutable_stamp()->set_nsec(
      static_cast<std::int32_t>(stamp_ns % 1'000'000'000));
  add(message, "jackal", 8, place.x_m, place.y_m, 0.0, place.yaw_rad);
  add(message, "crate", 40, 1.0, 1.0, 0.5, 0.3);
  add(message, "base_link", 9, 0.0, 0.0, 0.0635, 0.0);
  add(message, "front_left_wheel", 10, 0.131, 0.188, 0.098, 0.0);
  add(message, "base_link", 41, 0.0, 0.0, 7.0, 1.0);
  return message;
}

/// @return  What is sent.
std::string spoiled(msgs::Pose_V message, const std::string& fault) {
  if (fault == "nan") {
    message.mutable_pose(0)->mutable_position()->set_x(
        std::numeric_limits<double>::quiet_NaN());
  } else if (fault == "quaternion") {
    message.mutable_pose(2)->mutable_orientation()->set_w(3.0);
  } else if (fault == "entity") {
    message.mutable_pose(0)->set_name("somebody");
  } else if (fault == "stamp") {
    message.clear_header();
  } else if (fault == "garbage") {
    return "\xff\xff\xff no message";
  }
  return message.SerializeAsString();
}

/// Sends poses and counts answers.
class Peer {
 public:
  explicit Peer(Settings settings)
      : settings_(std::move(settings)),
        places_(read_drive(settings_.drive)),
        receiver_(settings_.images.size()),
        poses_(node_.Advertise("/world/" + settings_.world + "/dynamic_pose/info",
                               settings_.prefix + "Pose_V")) {
    for (std::size_t i = 0; i < settings_.images.size(); ++i) {
      node_.SubscribeRaw(
          settings_.images[i],
          [this, i](const char* bytes, const std::size_t size,
                    const ignition::transport::MessageInfo&) {
            receiver_.received(i, bytes, size);
          },
          settings_.prefix + "Image");
    }
    if (!settings_.advertise.empty()) {
      rival_ = node_.Advertise(settings_.advertise, settings_.prefix + "Image");
    }
    if (!settings_.info.empty()) {
      node_.SubscribeRaw(
          settings_.info,
          [this](const char* bytes, const std::size_t size,
                 const ignition::transport::MessageInfo&) {
            msgs::CameraInfo info;
            if (info.ParseFromArray(bytes, static_cast<int>(size))) {
              receiver_.received_info(info);
            }
          },
          settings_.prefix + "CameraInfo");
    }
  }

  int run() {
    if (places_.empty() || !poses_) return 2;
    if (!wait_for_answer()) {
      std::printf("no_answer 1\n");
      return 1;
    }
    receiver_.measure();
    const auto start = Clock::now();
    for (int i = 0; i < settings_.frames; ++i) {
      const bool faulty = settings_.fault_every > 0 && (i + 1) % settings_.fault_every == 0;
      send(i, kStart_ns, faulty);
      std::this_thread::sleep_until(start + period() * (i + 1));
    }
    const double elapsed_s = std::chrono::duration<double>(Clock::now() - start).count();
    for (int quiet = 0, last = -1; quiet < 5; ++quiet) {  // Answers under way.
      if (receiver_.complete() != last) quiet = 0;
      last = receiver_.complete();
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    receiver_.report(settings_.frames, elapsed_s);
    if (!settings_.dump.empty()) receiver_.dump(settings_.dump);
    return 0;
  }

 private:
  /// Measured poses begin here; a whole number of periods of 30 and 60 Hz.
  static constexpr std::int64_t kStart_ns = 1'000'000'000'000;

  [[nodiscard]] std::chrono::nanoseconds period() const {
    return std::chrono::nanoseconds(static_cast<std::int64_t>(1e9 / settings_.rate_hz));
  }

  void send(int index, std::int64_t start_ns, bool faulty) {
    const auto stamp_ns =
        start_ns + static_cast<std::int64_t>(std::llround(index * 1e9 / settings_.rate_hz));
    const msgs::Pose_V message =
        message_at(places_[static_cast<std::size_t>(index) % places_.size()], stamp_ns);
    receiver_.sent(stamp_ns);
    poses_.PublishRaw(faulty ? spoiled(message, settings_.fault) : message.SerializeAsString(),
                      settings_.prefix + "Pose_V");
  }

  /// Both sides find each other while the robot stands at the start of its drive.
  bool wait_for_answer() {
    const auto start = Clock::now();
    for (int i = 0;
         std::chrono::duration<double>(Clock::now() - start).count() < settings_.patience_s;
         ++i) {
      const std::int64_t stamp_ns = static_cast<std::int64_t>(i) * 50'000'000;
      const std::string bytes = message_at(places_.front(), stamp_ns).SerializeAsString();
      receiver_.sent(stamp_ns);
      poses_.PublishRaw(bytes, settings_.prefix + "Pose_V");
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
      if (receiver_.complete() >= 3) return true;
      if (settings_.images.empty() && poses_.HasConnections()) return true;
    }
    return false;
  }

  Settings settings_;
  std::vector<Place> places_;
  Receiver receiver_;
  ignition::transport::Node node_;
  ignition::transport::Node::Publisher poses_, rival_;
};

}  // namespace

int main(int argc, char** argv) { return Peer(read_settings(argc, argv)).run(); }
