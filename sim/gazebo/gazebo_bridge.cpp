#include "sim/gazebo/gazebo_bridge.h"

#include <ignition/msgs/camera_info.pb.h>
#include <ignition/msgs/image.pb.h>

#include <algorithm>
#include <chrono>
#include <mutex>
#include <optional>
#include <utility>

#include <oneapi/tbb/parallel_for.h>
#include <ignition/transport/Node.hh>

#include "core/error.h"
#include "core/task_order.h"
#include "sim/gazebo/gazebo_images.h"
#include "sim/gazebo/internal/gazebo_inbox.h"
#include "sim/gazebo/internal/gazebo_transport.h"
#include "sim/gazebo/internal/recent_times.h"

namespace segsim::sim {
namespace {

namespace msgs = ignition::msgs;
using ignition::transport::Node;
using internal::Dialect;
using internal::GazeboInbox;
using internal::GazeboView;

constexpr std::chrono::milliseconds kPatience{100};

/// One topic in every dialect.
template <class Message>
class Stream {
 public:
  Stream(std::vector<std::unique_ptr<Dialect>>& dialects, const std::string& topic,
         const char* type, const std::string& frame_id) {
    if (topic.empty()) return;
    for (const auto& dialect : dialects) {
      Voice voice{dialect->node.Advertise(topic, dialect->prefix + type),
                  dialect->prefix + type};
      if (!voice.publisher) {
        throw core::InputError::expected(frame_id, "a topic name of its own", topic);
      }
      voices_.push_back(std::move(voice));
    }
    auto* entry = message.mutable_header()->add_data();
    entry->set_key("frame_id");
    entry->add_value(frame_id);
    entry = message.mutable_header()->add_data();
    entry->set_key("seq");
    entry->add_value("0");
  }

  [[nodiscard]] bool watched() const {
    return std::any_of(voices_.begin(), voices_.end(),
                       [](const Voice& voice) { return voice.publisher.HasConnections(); });
  }

  /// Sends `message` to whoever listens.
  void publish(core::TimeNs stamp_ns) {
    auto* header = message.mutable_header();
    header->mutable_stamp()->set_sec(stamp_ns / core::kNsPerSecond);
    header->mutable_stamp()->set_nsec(
        static_cast<std::int32_t>(stamp_ns % core::kNsPerSecond));
    header->mutable_data(1)->set_value(0, std::to_string(sequence_++));
    for (Voice& voice : voices_) {
      if (!voice.publisher.HasConnections()) continue;
      if (voice.type == message.GetTypeName()) {
        voice.publisher.Publish(message);  // One copy of the image less.
      } else {
        message.SerializeToString(&bytes_);
        voice.publisher.PublishRaw(bytes_, voice.type);
      }
      ++messages_sent;
      bytes_sent += message.ByteSizeLong();
    }
  }

  Message message;
  std::uint64_t messages_sent = 0, bytes_sent = 0;

 private:
  struct Voice {
    Node::Publisher publisher;
    std::string type;
  };
  std::vector<Voice> voices_;
  std::string bytes_;
  std::uint64_t sequence_ = 0;
};

using ImageStream = Stream<msgs::Image>;

void describe(const core::CameraIntrinsics& camera, msgs::PixelFormatType format,
              std::uint32_t pixel_bytes, msgs::Image& image) {
  const auto width = static_cast<std::uint32_t>(camera.width_px);
  image.set_width(width);
  image.set_height(static_cast<std::uint32_t>(camera.height_px));
  image.set_step(width * pixel_bytes);
  image.set_pixel_format_type(format);
}

/// As CameraSensor::PopulateInfo does for a camera without distortion.
void describe(const core::CameraIntrinsics& camera, msgs::CameraInfo& info) {
  info.set_width(static_cast<std::uint32_t>(camera.width_px));
  info.set_height(static_cast<std::uint32_t>(camera.height_px));
  info.mutable_distortion()->set_model(msgs::CameraInfo::Distortion::PLUMB_BOB);
  for (int i = 0; i < 5; ++i) info.mutable_distortion()->add_k(0.0);
  for (const double k :
       {camera.fx_px, 0.0, camera.cx_px, 0.0, camera.fy_px, camera.cy_px, 0.0, 0.0, 1.0}) {
    info.mutable_intrinsics()->add_k(k);
  }
  for (const double p : {camera.fx_px, 0.0, camera.cx_px, 0.0, 0.0, camera.fy_px, camera.cy_px,
                         0.0, 0.0, 0.0, 1.0, 0.0}) {
    info.mutable_projection()->add_p(p);
  }
  for (const double r : {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}) {
    info.add_rectification_matrix(r);
  }
}

/// All topics of one camera.
struct CameraStreams {
  CameraStreams(std::vector<std::unique_ptr<Dialect>>& dialects, const GazeboCamera& camera)
      : rgb(dialects, camera.rgb_topic, "Image", camera.frame_id),
        depth(dialects, camera.depth_topic, "Image", camera.frame_id),
        labels(dialects, camera.labels_topic, "Image", camera.frame_id),
        colored(dialects, camera.colored_topic, "Image", camera.frame_id),
        info(dialects, camera.info_topic, "CameraInfo", camera.frame_id),
        near_m(camera.near_m),
        far_m(camera.far_m),
        coding(camera.labels) {
    for (ImageStream* stream : {&rgb, &labels, &colored}) {
      describe(camera.intrinsics, msgs::PixelFormatType::RGB_INT8, 3, stream->message);
    }
    describe(camera.intrinsics, msgs::PixelFormatType::R_FLOAT32, 4, depth.message);
    describe(camera.intrinsics, info.message);
  }

  [[nodiscard]] core::Channels wanted() const {
    auto channels = core::Channels::kNone;
    if (rgb.watched()) channels = channels | core::Channels::kRgb;
    if (depth.watched()) channels = channels | core::Channels::kDepth;
    if (labels.watched() || colored.watched()) channels = channels | core::Channels::kLabels;
    return channels;
  }

  /// Appends what has to be done for one frame; the parts touch nothing of one another.
  /// @param frame  Holds the channels that were wanted.
  void add_work(const core::Frame& frame, core::Channels channels, core::TimeNs stamp_ns,
                const GazeboLabelEncoder& encoder, std::vector<std::function<void()>>& work) {
    const auto add = [&](ImageStream& stream, core::Channels channel, auto encode) {
      if (!has(channels, channel) || !stream.watched()) return;
      work.emplace_back([&stream, stamp_ns, encode] {
        encode(*stream.message.mutable_data());
        stream.publish(stamp_ns);
      });
    };
    if (info.watched()) work.emplace_back([this, stamp_ns] { info.publish(stamp_ns); });
    add(depth, core::Channels::kDepth, [this, &frame](std::string& bytes) {
      encode_depth(frame.depth_m, near_m, far_m, bytes);
    });
    add(rgb, core::Channels::kRgb,
        [&frame](std::string& bytes) { encode_rgb(frame.rgb, bytes); });
    add(labels, core::Channels::kLabels, [this, &frame, &encoder](std::string& bytes) {
      encoder.encode_labels(frame, coding, bytes);
    });
    add(colored, core::Channels::kLabels, [this, &frame, &encoder](std::string& bytes) {
      encoder.encode_colors(frame, coding, bytes);
    });
  }

  void count(GazeboTraffic& traffic) const {
    for (const ImageStream* stream : {&rgb, &depth, &labels, &colored}) {
      traffic.images += stream->messages_sent;
      traffic.bytes += stream->bytes_sent;
    }
    traffic.images += info.messages_sent;
    traffic.bytes += info.bytes_sent;
  }

  ImageStream rgb, depth, labels, colored;
  Stream<msgs::CameraInfo> info;
  double near_m, far_m;
  GazeboLabels coding;
};

/// Reads messages into the inbox. Callbacks hold it by shared pointer: one may still be under
/// way when the bridge goes.
class Receiver {
 public:
  explicit Receiver(const std::vector<GazeboView>& views) : inbox(views) {}

  void receive(const char* bytes, std::size_t size) {
    const auto arrival = GazeboInbox::Clock::now();
    const std::lock_guard lock(mutex_);
    if (message_.read(bytes, size)) {
      inbox.put(message_.stamp_ns(), message_.entities(), arrival);
    } else {
      inbox.put_unreadable(size);
    }
  }

  GazeboInbox inbox;

 private:
  std::mutex mutex_;
  internal::PoseMessage message_;
};

}  // namespace

struct GazeboBridge::Parts {
  Parts(GazeboBridgeOptions bridge_options, core::Renderer& scene_renderer,
        const core::SceneManifest& scene)
      : options(std::move(bridge_options)),
        renderer(scene_renderer),
        encoder(scene),
        views(internal::make_views(options.cameras)),
        receiver(std::make_shared<Receiver>(views)),
        dialects(internal::make_dialects(options.flavour)) {
    if (views.empty()) {
      throw core::InputError::expected("Gazebo bridge", "at least one camera", "none");
    }
    if (options.pose_topic.empty()) {
      options.pose_topic = "/world/" + options.world + "/dynamic_pose/info";
    }
    for (const GazeboView& view : views) {
      auto& of_view = streams.emplace_back();
      for (const GazeboCamera& camera : view.cameras) {
        of_view.push_back(std::make_unique<CameraStreams>(dialects, camera));
      }
    }
    for (const auto& dialect : dialects) {
      const auto inbox = receiver;
      if (!dialect->node.SubscribeRaw(
              options.pose_topic,
              [inbox](const char* bytes, const std::size_t size,
                      const ignition::transport::MessageInfo&) {
                inbox->receive(bytes, size);
              },
              dialect->prefix + "Pose_V")) {
        throw core::InputError::expected("pose topic", "a valid name of a topic",
                                         options.pose_topic);
      }
    }
  }

  void serve(const GazeboInbox::Job& job) {
    auto channels = core::Channels::kNone;
    for (const auto& camera : streams[job.view]) channels = channels | camera->wanted();
    const bool drawn = channels != core::Channels::kNone;
    const auto start = GazeboInbox::Clock::now();
    if (drawn) {
      renderer.render(job.T_world_camera, views[job.view].camera().intrinsics, channels,
                      frame);
    }
    const auto rendered = GazeboInbox::Clock::now();
    std::vector<std::function<void()>> work;
    for (const auto& camera : streams[job.view]) {
      camera->add_work(frame, channels, job.stamp_ns, encoder, work);
    }
    core::TaskOrder order;
    tbb::parallel_for(std::size_t{0}, work.size(), [&](std::size_t i) {
      const core::TaskOrder::Task task(order);
      work[i]();
    });
    order.wait();

    using Milliseconds = std::chrono::duration<double, std::milli>;
    const std::lock_guard lock(mutex);
    if (!drawn) ++totals.unwatched;
    totals.images = totals.bytes = 0;
    for (const auto& view : streams) {
      for (const auto& camera : view) camera->count(totals);
    }
    if (!drawn) return;
    ++totals.frames;
    render_times.add(Milliseconds(rendered - start).count());
    answer_times.add(Milliseconds(GazeboInbox::Clock::now() - job.arrival).count());
  }

  GazeboBridgeOptions options;
  core::Renderer& renderer;
  GazeboLabelEncoder encoder;
  std::vector<GazeboView> views;
  std::shared_ptr<Receiver> receiver;
  std::vector<std::unique_ptr<Dialect>> dialects;
  std::vector<std::vector<std::unique_ptr<CameraStreams>>> streams;  ///< [view][camera]
  core::Frame frame;
  std::mutex mutex;  ///< Of what follows.
  GazeboTraffic totals;
  internal::RecentTimes render_times, answer_times;
};

GazeboBridge::GazeboBridge(GazeboBridgeOptions options, core::Renderer& renderer,
                           const core::SceneManifest& scene)
    : parts_(std::make_unique<Parts>(std::move(options), renderer, scene)) {}

GazeboBridge::~GazeboBridge() = default;

void GazeboBridge::run(const std::function<bool()>& keep_going) {
  while (keep_going()) {
    if (const auto job = parts_->receiver->inbox.take(kPatience)) parts_->serve(*job);
  }
}

GazeboStatus GazeboBridge::status() const {
  GazeboStatus status;
  parts_->receiver->inbox.fill(status);
  const std::lock_guard lock(parts_->mutex);
  status.traffic.unwatched = parts_->totals.unwatched;
  status.traffic.frames = parts_->totals.frames;
  status.traffic.images = parts_->totals.images;
  status.traffic.bytes = parts_->totals.bytes;
  status.render_median_ms = parts_->render_times.quantile_ms(0.5);
  status.render_p95_ms = parts_->render_times.quantile_ms(0.95);
  status.answer_median_ms = parts_->answer_times.quantile_ms(0.5);
  status.answer_p95_ms = parts_->answer_times.quantile_ms(0.95);
  return status;
}

std::vector<std::string> GazeboBridge::contested_topics() const {
  std::vector<std::string> contested;
  for (const GazeboCamera& camera : parts_->options.cameras) {
    for (const std::string& topic : {camera.rgb_topic, camera.depth_topic, camera.labels_topic,
                                     camera.colored_topic, camera.info_topic}) {
      if (topic.empty()) continue;
      std::vector<ignition::transport::MessagePublisher> publishers;
      parts_->dialects.front()->node.TopicInfo(topic, publishers);
      // Ours are among them, one for each dialect.
      if (publishers.size() > parts_->dialects.size()) contested.push_back(topic);
    }
  }
  return contested;
}

const std::string& GazeboBridge::pose_topic() const { return parts_->options.pose_topic; }

}  // namespace segsim::sim
