#pragma once

/// @file
/// What all file-based layouts share: a loader lists the frames, `finish_sequence` checks the
/// files, brings the poses to the world frame and makes the sequence.

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "reconstruction/datasets/color_depth.h"
#include "reconstruction/datasets/depth_sensor.h"
#include "reconstruction/datasets/internal/image_files.h"
#include "reconstruction/datasets/internal/lens.h"
#include "reconstruction/datasets/label_map.h"
#include "reconstruction/datasets/pose_track.h"
#include "reconstruction/datasets/rgbd_sequence.h"
#include "reconstruction/datasets/world_placement.h"

namespace segsim::reconstruction::internal {

/// Files of one frame; empty path = there is none.
struct FrameFiles {
  std::string name;
  std::filesystem::path rgb, depth_png, depth_exr, semantic, instance;
  std::filesystem::path valid;         ///< 8 bit, 0 = ignore the pixel.
  core::CameraPose T_world_camera;     ///< In the source's world until finish_sequence.
  std::optional<double> time_s;        ///< Of the colour image.
  std::optional<double> depth_time_s;  ///< Of the depth image, by the same clock.
  /// From the colour camera when depth was measured to the colour camera when the colour image
  /// was taken; apply_times() fills it in.
  std::optional<CameraToCamera> T_color_moved;
  std::vector<std::uint32_t> seen_points;  ///< Indices of SequenceParts::sparse_points_m.
};

struct SequenceParts {
  std::string name;
  core::CameraIntrinsics intrinsics;  ///< Ignored if there is a lens.
  /// Of the colour images as they lie on disk. If it bends, all images are straightened, and
  /// `intrinsics` becomes the pinhole camera that does.
  std::optional<Lens> lens;
  /// Of the depth images, if it is not the colour camera at their size ...
  std::optional<core::CameraIntrinsics> depth_camera;
  /// ... and where it stands, if not where the colour camera does.
  std::optional<CameraToCamera> T_color_depth;
  DepthSensor sensor = DepthSensor::kUnstated;
  /// Poses by time, if they were measured apart from the images; in the source's world until
  /// finish_sequence, which makes it of the frames' poses where these have times.
  PoseTrack track;
  TimeOptions times;           ///< Those that frames had to follow.
  double depth_unit_m = 1e-3;  ///< Metres per count of a depth PNG.
  double depth_scale = 1.0;    ///< Of all depth; finish_sequence fills it in.
  /// Depth images are SequenceOptions::own_depth: metres, of the straight view.
  bool own_depth = false;
  /// Of the source's own reconstruction, in the source's world until finish_sequence.
  std::vector<glm::dvec3> sparse_points_m;
  std::vector<FrameFiles> frames;
  bool has_masks = false;
  /// Classes of the label images; empty: labels.yaml's, whose ids are taken as they are. With
  /// it `instances` is filled from the images, and ids of stuff and void become 0.
  std::optional<LabelMap> label_map;
  std::uint16_t last_instance = 65535;  ///< Larger instance ids of the source mean none.
  std::vector<core::SceneClass> classes;
  std::vector<core::SceneInstance> instances;
  std::vector<std::uint16_t> crowds;  ///< RgbdFrame::crowds.
  std::vector<std::string> warnings, notes;
  WorldPlacement placement;  ///< place_world() fills it in, and the poses' way to our world.
  core::Transform<core::frame::World, core::frame::World> T_world_source;
};

/// How to bring the source's world to ours.
struct WorldConvention {
  double depth_scale = 1.0, pose_scale = 1.0;  ///< As SequenceOptions has them.
  bool ignore_depth = false;
  std::filesystem::path own_depth;
  bool invert_poses = false;
  UpAxis up = UpAxis::kZ;             ///< kY or kZ.
  bool up_given = false;              ///< By hand: evidence is not asked.
  std::optional<glm::dvec3> gravity;  ///< By hand, in the source's world; instead of `up`.
  /// False: all of it is known, and a floor without height is at 0.
  bool fit_floor = true;
  std::optional<double> floor_height_m;   ///< Along `up`, in the source's world.
  std::vector<glm::vec3> floor_points_m;  ///< SequenceOptions::floor_points_m.
  std::optional<ColorDepth> color_depth;
  DepthSensor sensor = DepthSensor::kUnstated;
  TimeOptions times;
};

/// Runs `check`; an InputError becomes a warning with the frame's name under
/// OnBadFrame::kSkip.
/// @return false if the frame is to be left out.
[[nodiscard]] bool accept_frame(OnBadFrame on_bad_frame, const std::string& frame_name,
                                std::vector<std::string>& warnings,
                                const std::function<void()>& check);

/// Size of the first colour image that is intact.
/// @throws InputError if none is.
[[nodiscard]] ImageSize first_image_size(const std::vector<FrameFiles>& frames,
                                         const std::filesystem::path& folder);

/// Whether an image of that size can show the camera's view: the ratio of its sides differs by
/// less than 2 %.
[[nodiscard]] bool has_aspect_of(const core::CameraIntrinsics& camera, int width_px,
                                 int height_px);

/// Name of a recording by its folder.
[[nodiscard]] std::string sequence_name(const std::filesystem::path& folder);

/// The label map that the options name, else the one that `own` reads, else nothing, with a
/// warning that label images are left alone. For sources that have label images.
[[nodiscard]] std::optional<LabelMap> choose_label_map(
    const SequenceOptions& options, const std::function<std::optional<LabelMap>()>& own,
    std::vector<std::string>& warnings);

/// Reads a world convention off the options; `habit` is the layout's own up axis.
[[nodiscard]] WorldConvention convention_of(const SequenceOptions& options, UpAxis habit);

/// Makes poses out of camera axes of OpenGL (x right, y up, z backward): negates the second
/// and third column of a row-major 4x4.
void turn_opengl_axes(std::vector<double>& matrix);

[[nodiscard]] std::unique_ptr<RgbdSequence> finish_sequence(
    SequenceParts parts, const std::filesystem::path& folder,
    const WorldConvention& convention, OnBadFrame on_bad_frame);

// The loaders, one file each.
[[nodiscard]] bool looks_like_hololens(const std::filesystem::path& folder);
[[nodiscard]] std::unique_ptr<RgbdSequence> open_hololens(const std::filesystem::path& folder,
                                                          const SequenceOptions& options);
[[nodiscard]] bool looks_like_seven_scenes(const std::filesystem::path& folder);
[[nodiscard]] std::unique_ptr<RgbdSequence> open_seven_scenes(
    const std::filesystem::path& folder, const SequenceOptions& options);
[[nodiscard]] bool looks_like_scannet(const std::filesystem::path& folder);
[[nodiscard]] std::unique_ptr<RgbdSequence> open_scannet(const std::filesystem::path& folder,
                                                         const SequenceOptions& options);
[[nodiscard]] bool looks_like_scannetpp(const std::filesystem::path& folder);
[[nodiscard]] std::unique_ptr<RgbdSequence> open_scannetpp(const std::filesystem::path& folder,
                                                           const SequenceOptions& options);
[[nodiscard]] bool looks_like_replica(const std::filesystem::path& folder);
[[nodiscard]] std::unique_ptr<RgbdSequence> open_replica(const std::filesystem::path& folder,
                                                         const SequenceOptions& options);
[[nodiscard]] bool looks_like_tum(const std::filesystem::path& folder);
[[nodiscard]] std::unique_ptr<RgbdSequence> open_tum(const std::filesystem::path& folder,
                                                     const SequenceOptions& options);
[[nodiscard]] bool looks_like_nerfstudio(const std::filesystem::path& folder);
[[nodiscard]] std::unique_ptr<RgbdSequence> open_nerfstudio(
    const std::filesystem::path& folder, const SequenceOptions& options);
[[nodiscard]] bool looks_like_colmap(const std::filesystem::path& folder);
[[nodiscard]] std::unique_ptr<RgbdSequence> open_colmap(const std::filesystem::path& folder,
                                                        const SequenceOptions& options);

}  // namespace segsim::reconstruction::internal
