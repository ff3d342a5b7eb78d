#pragma once

/// @file
/// A renderer as the camera of a running Gazebo, over Gazebo's own transport.
///
///     Gazebo --poses--> [due poses of each view] --> renderer --> images, camera info
///                       few wait, rest dropped                    to who subscribed
///
/// Gazebo is not changed: the bridge subscribes to the poses that its SceneBroadcaster sends
/// to any viewer, and publishes on the topics and in the encodings that its sensors would use
/// (sim/gazebo/gazebo_cameras.h, sim/gazebo/gazebo_images.h). Like those it draws nothing that
/// nobody subscribed to, and stamps each image with the simulated time of its pose.
///
/// Poses arrive on a thread of the transport and never wait for a picture: each view keeps one
/// pose, and a newer one takes its place, so what falls behind is dropped here and counted.
/// Memory is bounded towards slow subscribers too: see kSendQueue.

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/render.h"
#include "core/scene_bundle.h"
#include "sim/gazebo/gazebo_cameras.h"
#include "sim/gazebo/gazebo_pose.h"

namespace segsim::sim {

/// How messages are named: Fortress says ignition.msgs.Image, Garden and later gz.msgs.Image.
/// On the wire they are the same otherwise; a subscriber of the one hears nothing of the
/// other.
enum class GazeboFlavour : std::uint8_t {
  kIgnition,
  kGz,
  kBoth,  ///< Listens to both; answers each subscriber in its own.
};

/// Messages that wait for one subscriber before further ones to it are dropped: four frames of
/// four images. The transport's own default is 1000, several gigabytes of images. The
/// environment variable IGN_TRANSPORT_SNDHWM overrides it.
inline constexpr int kSendQueue = 16;

struct GazeboBridgeOptions {
  std::string world;
  std::string pose_topic;  ///< Empty: `/world/<world>/dynamic_pose/info`
  GazeboFlavour flavour = GazeboFlavour::kBoth;
  std::vector<GazeboCamera> cameras;
};

/// What became of every pose message and every frame.
struct GazeboTraffic {
  std::uint64_t poses = 0;                          ///< Messages received.
  std::array<std::uint64_t, kPoseFaults> faulty{};  ///< By PoseFault, for each view.
  std::string last_fault;                           ///< In words.
  std::uint64_t early = 0;       ///< Between two pictures of a camera; no loss.
  std::uint64_t repeated = 0;    ///< Gazebo was paused; no loss.
  std::uint64_t unwatched = 0;   ///< Due, but nobody subscribed; no loss.
  std::uint64_t superseded = 0;  ///< Due, but a newer one came first: a dropped frame.
  std::uint64_t restarts = 0;    ///< Simulated time went back.
  std::uint64_t frames = 0;      ///< Views drawn and published.
  std::uint64_t images = 0;      ///< Messages published, camera info included.
  std::uint64_t bytes = 0;

  [[nodiscard]] std::uint64_t faults() const;
};

struct GazeboStatus {
  GazeboTraffic traffic;
  double since_pose_s = -1.0;  ///< Age of the last message; negative: none yet.
  /// Over the last 4096 frames; 0 before the first.
  double render_median_ms = 0.0, render_p95_ms = 0.0;
  /// From the arrival of a pose until the transport has its last image.
  double answer_median_ms = 0.0, answer_p95_ms = 0.0;
};

class GazeboBridge {
 public:
  /// Subscribes and advertises at once. Cameras with the same place and intrinsics share one
  /// view, which is drawn once. Partition and address are taken from IGN_PARTITION and IGN_IP,
  /// or, where these are not set, from GZ_PARTITION and GZ_IP.
  /// @param renderer  Used by run() alone; must outlive the bridge.
  /// @throws core::InputError: a topic that is no topic or used twice, no camera, class ids
  ///     above 255, or a program without the bridge.
  GazeboBridge(GazeboBridgeOptions options, core::Renderer& renderer,
               const core::SceneManifest& scene);
  ~GazeboBridge();
  GazeboBridge(const GazeboBridge&) = delete;
  GazeboBridge& operator=(const GazeboBridge&) = delete;

  /// Serves on this thread while `keep_going` says so; it is asked after every frame and at
  /// least ten times a second. What the renderer throws ends it.
  void run(const std::function<bool()>& keep_going);
  /// From any thread.
  [[nodiscard]] GazeboStatus status() const;
  [[nodiscard]] const std::string& pose_topic() const;
  /// Topics of ours that somebody else publishes as well, as far as is known by now: most
  /// likely Gazebo's own sensors, whose images would mingle with these.
  [[nodiscard]] std::vector<std::string> contested_topics() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace segsim::sim
