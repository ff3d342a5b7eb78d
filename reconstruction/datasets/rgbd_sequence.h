#pragma once

/// @file
/// Recorded RGB-D frames with poses, whatever their layout on disk. Loaders bring every source
/// to one convention: metres, world z up with the floor near z = 0, camera x right / y down /
/// z forward, pixel centres at +0.5, depth along +z with NaN for "no measurement".
///
/// Layouts (rgbd_sequence.cpp holds the table; a new source adds a row and a file;
/// docs/datasets.md has the details):
///
///     hololens    rgb/NNNNN.jpg, depth/NNNNN.png, K.txt, poses.txt
///     7scenes     frame-NNNNNN.{color.jpg|color.png, depth.png, pose.txt}, intrinsics.txt;
///                 optional: .semantic.png, .instance.png, .depth.exr and labels.yaml
///     scannet     color/, depth/, pose/, intrinsic/ (SensReader), label-filt/, instance-filt/
///     scannetpp   dslr/ or iphone/ with colmap/ and images
///     replica     rgb/rgb_N.png, depth/depth_N.png, traj_w_c.txt (semantic-nerf), or
///                 results/frameNNNNNN.jpg, traj.txt (NICE-SLAM)
///     tum         rgb.txt, depth.txt, groundtruth.txt
///     nerfstudio  transforms.json
///     colmap      sparse/0/{cameras,images}.{bin,txt}, images/

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <glm/vec3.hpp>

#include "core/camera.h"
#include "core/frames.h"
#include "core/image.h"
#include "core/scene_bundle.h"
#include "reconstruction/datasets/color_depth.h"
#include "reconstruction/datasets/depth_sensor.h"
#include "reconstruction/datasets/pose_track.h"
#include "reconstruction/datasets/world_placement.h"

namespace segsim::reconstruction {

/// One posed RGB-D picture.
struct RgbdFrame {
  std::string name;             ///< As on disk, for messages: "00042", "frame-000042".
  core::Image<core::Rgb8> rgb;  ///< sRGB, size of RgbdSequence::intrinsics().
  core::Image<float> depth_m;  ///< Along +z; NaN = invalid. Same view as rgb; size may differ.
                               ///< Empty if the frame has none.
  core::CameraPose T_world_camera;
  core::Image<std::uint16_t>
      semantic;  ///< Class id, 0 = void; size of rgb. Empty without masks.
  core::Image<std::uint16_t>
      instance;  ///< Instance id, 0 = none; size of rgb. Empty without masks.
  /// Instance ids of crowds (core::MaskSegment::crowd), ascending, also of those out of view.
  std::vector<std::uint16_t> crowds;
  core::Image<std::uint8_t> valid;  ///< 0 = not to be learned from (anonymised, moving); size
                                    ///< of rgb. Empty: all pixels count.
};

enum class SequenceLayout : std::uint8_t {
  kAuto,
  kHololens,
  kSevenScenes,
  kScanNet,
  kScanNetPlusPlus,
  kReplica,
  kTum,
  kNerfstudio,
  kColmap
};
/// Axis of the source's world that points up. kAuto = the layout's own habit (hololens y, all
/// others z), unless surfaces and cameras say otherwise.
enum class UpAxis : std::uint8_t { kAuto, kY, kZ };
/// What to do with a frame whose pose or image file is broken.
enum class OnBadFrame : std::uint8_t { kRefuse, kSkip };

/// Clocks of colour images, depth images and poses. With an offset, also of 0, what was
/// measured between two stamps is found by interpolation of the poses; without, each image
/// takes what has the nearest stamp, or what has its number.
struct TimeOptions {
  /// Frames of a layout without time stamps have the time of the number in their names divided
  /// by this.
  std::optional<double> frame_rate_hz;
  /// What is added to the stamps of depth images. Depth is then brought to where the camera
  /// was when the colour image was taken.
  std::optional<double> depth_offset_s;
  /// What is added to the stamps of poses.
  std::optional<double> pose_offset_s;
  /// Rolling shutter: how long the colour camera reads its rows, first to last, around the
  /// image's time; negative: from below. Pictures are straightened on loading.
  std::optional<double> read_out_s;

  [[nodiscard]] bool shifts() const { return depth_offset_s || pose_offset_s || read_out_s; }
};

struct SequenceOptions {
  SequenceLayout layout = SequenceLayout::kAuto;
  /// Given, it is taken for exact; kAuto is checked against what the recording shows.
  UpAxis up_axis = UpAxis::kAuto;
  /// Direction in which things fall, in the source's world, of any length; instead of up_axis.
  std::optional<glm::dvec3> gravity;
  OnBadFrame on_bad_frame = OnBadFrame::kRefuse;
  /// What lengths are multiplied with to become metres, beyond the layout's own unit.
  double depth_scale = 1.0, pose_scale = 1.0;
  /// The files hold the inverses of the poses that the layout says they hold.
  bool invert_poses = false;
  /// Height of the floor along up, in the source's world; it becomes world z = 0. Without it
  /// the floor is found in the depth of a few frames. Ignored, like up_axis and gravity, if
  /// labels.yaml is there.
  std::optional<double> floor_height_m;
  /// What else was measured there (a LiDAR cloud), in the source's world: the floor is fitted
  /// to it if no frame has depth.
  std::vector<glm::vec3> floor_points_m;
  /// Classes of the label images of a data set (label_map.h). Empty: the data set's own table,
  /// if it has one; else its label images are left alone, with a warning.
  std::filesystem::path label_map;
  /// The recording's own depth images are left alone.
  bool ignore_depth = false;
  /// Depth images that take the place of the recording's: the i-th frame's is named
  /// own_depth_name(i), channel Z [m] along +z of the straightened view, of any size. A frame
  /// without has no depth. Empty: the recording's.
  std::filesystem::path own_depth;
  /// Depth images are those of another camera, and are reprojected into the colour camera.
  /// None: they are of the colour camera's view, as the layout has it.
  std::optional<ColorDepth> color_depth;
  TimeOptions times;
  /// What measured depth. Flying pixels are removed; lifting and training weigh depth by its
  /// error (RgbdSequence::sensor()).
  DepthSensor sensor = DepthSensor::kUnstated;
};

/// The number at the end of a frame's name; nothing if there is none.
[[nodiscard]] std::optional<std::int64_t> frame_number(const std::string& name);

/// "000042.exr"
[[nodiscard]] std::string own_depth_name(std::size_t frame);

/// Read-only sequence. All functions are const and may be called by many threads at once.
class RgbdSequence {
 public:
  RgbdSequence() = default;
  virtual ~RgbdSequence() = default;
  RgbdSequence(const RgbdSequence&) = delete;
  RgbdSequence& operator=(const RgbdSequence&) = delete;

  [[nodiscard]] virtual const std::string& name() const = 0;
  /// Of the colour images. A depth image of another size has intrinsics().resized(its size).
  [[nodiscard]] virtual const core::CameraIntrinsics& intrinsics() const = 0;
  [[nodiscard]] virtual std::size_t frame_count() const = 0;
  [[nodiscard]] virtual const std::string& frame_name(std::size_t i) const = 0;
  [[nodiscard]] virtual const core::CameraPose& pose(std::size_t i) const = 0;
  /// When the colour image was taken [s], from any origin; nothing where the source does not
  /// tell.
  [[nodiscard]] virtual std::optional<double> time_s(std::size_t /*i*/) const {
    return std::nullopt;
  }
  /// When its depth image was taken, by the same clock as time_s().
  [[nodiscard]] virtual std::optional<double> depth_time_s(std::size_t /*i*/) const {
    return std::nullopt;
  }
  /// T_world_camera by that clock; empty without times.
  [[nodiscard]] virtual const PoseTrack& pose_track() const;
  /// What measured depth, if that was stated.
  [[nodiscard]] virtual DepthSensor sensor() const { return DepthSensor::kUnstated; }
  /// @throws InputError if the files changed or broke since the sequence was opened.
  [[nodiscard]] virtual RgbdFrame load(std::size_t i) const = 0;
  /// From the coordinates of the source's poses to the world frame: the way that other
  /// measurements of the place (a LiDAR cloud) take.
  [[nodiscard]] virtual core::Transform<core::frame::World, core::frame::World>
  T_world_source() const {
    return {};
  }
  /// False if frames lack depth: such a sequence can be trained on, but not lifted.
  [[nodiscard]] virtual bool has_depth() const { return true; }
  /// True if load() delivers semantic and instance images.
  [[nodiscard]] virtual bool has_masks() const = 0;
  /// Meaning of the ids in the masks, ascending by id; empty without masks.
  [[nodiscard]] virtual const std::vector<core::SceneClass>& classes() const = 0;
  /// Boxes are zero where the source does not give them.
  [[nodiscard]] virtual const std::vector<core::SceneInstance>& instances() const = 0;
  /// One line per frame that was skipped, and per doubt.
  [[nodiscard]] virtual const std::vector<std::string>& warnings() const = 0;
  /// Conventions that were applied, in words, for the log and the manifest.
  [[nodiscard]] virtual const std::vector<std::string>& notes() const = 0;
  /// Points of the source's own sparse reconstruction that frame i saw, world frame. Empty
  /// where the source has none (only COLMAP models do).
  [[nodiscard]] virtual std::vector<glm::dvec3> seen_points_m(std::size_t /*i*/) const {
    return {};
  }
  /// How up and floor were decided; nullptr if the source does not say.
  [[nodiscard]] virtual const WorldPlacement* placement() const { return nullptr; }
};

/// Opens a recording and checks it: intrinsics, every pose (finite, rotation orthonormal
/// within 1e-2 and right-handed; then re-orthonormalised), and every image file (complete, PNG
/// checksums, size). A single pose far from those before and after is a broken frame; other
/// jumps of the path are warnings. Frames are in ascending order of their names.
/// @throws InputError naming the file, what was expected and what was found; with
/// OnBadFrame::kSkip only for faults of the whole sequence, and if no frame is left.
[[nodiscard]] std::unique_ptr<RgbdSequence> open_sequence(const std::filesystem::path& folder,
                                                          const SequenceOptions& options = {});

/// A frame's depth at the size of its colour image, by the nearest measurement: a mean over an
/// edge is on neither side of it. Empty stays empty.
[[nodiscard]] core::Image<float> depth_of_size(const core::Image<float>& depth_m, int width_px,
                                               int height_px);

/// "auto", "hololens", "7scenes", "scannet", "scannetpp", "replica", "tum", "nerfstudio",
/// "colmap"; "y", "z", "auto"; "refuse", "skip".
/// @param place  For the message, for example "scene.yaml:3: layout".
/// @throws InputError for another word.
[[nodiscard]] SequenceLayout parse_sequence_layout(const std::string& word,
                                                   const std::string& place);
[[nodiscard]] UpAxis parse_up_axis(const std::string& word, const std::string& place);
[[nodiscard]] OnBadFrame parse_on_bad_frame(const std::string& word, const std::string& place);

}  // namespace segsim::reconstruction
