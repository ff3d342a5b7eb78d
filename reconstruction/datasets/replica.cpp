/// @file
/// Renderings of Replica (Straub et al. 2019), 4 x 4 camera-to-world poses with axes x right,
/// y down, z forward, one a line; metres; integer pixel centres.
///
/// Semantic-NeRF's (Zhi et al., ICCV 2021), folders Sequence_1 and Sequence_2 of a scene:
///
///     rgb/rgb_<n>.png, depth/depth_<n>.png (uint16 millimetres), traj_w_c.txt
///     semantic_class/semantic_class_<n>.png, semantic_instance/semantic_instance_<n>.png
///     ../habitat/info_semantic.json    names of the classes
///     640 x 480 with f = 320 px, unless intrinsics.txt says otherwise
///
/// NICE-SLAM's (Zhu et al., CVPR 2022), without labels:
///
///     results/frame<nnnnnn>.jpg, results/depth<nnnnnn>.png (uint16, 6553.5 a metre), traj.txt
///     1200 x 680 with f = 600 px, unless intrinsics.txt says otherwise

#include "core/error.h"
#include "reconstruction/datasets/internal/calibration_files.h"
#include "reconstruction/datasets/internal/file_sequence.h"
#include "reconstruction/datasets/internal/listing.h"

namespace segsim::reconstruction::internal {
namespace {

namespace fs = std::filesystem;
using core::InputError;

/// How one rendering calls its files.
struct Rendering {
  const char* name;
  const char* poses;
  const char *color_folder, *color_prefix;
  const char *depth_folder, *depth_prefix;
  double depth_unit_m;
  core::CameraIntrinsics camera;  ///< With pixel centres at + 0.5.
};

const Rendering kSemanticNerf{
    "semantic-nerf", "traj_w_c.txt", "rgb", "rgb_",
    "depth",         "depth_",       1e-3,  {640, 480, 320.0, 320.0, 320.0, 240.0}};
const Rendering kNiceSlam{
    "NICE-SLAM", "traj.txt", "results",    "frame",
    "results",   "depth",    1.0 / 6553.5, {1200, 680, 600.0, 600.0, 600.0, 340.0}};

const Rendering* rendering_of(const fs::path& folder) {
  for (const Rendering* r : {&kSemanticNerf, &kNiceSlam}) {
    if (fs::exists(folder / r->poses) && fs::is_directory(folder / r->color_folder)) return r;
  }
  return nullptr;
}

std::optional<LabelMap> replica_classes(const fs::path& folder) {
  for (const fs::path& place : {folder, folder / "..", folder / "../.."}) {
    for (const char* name : {"info_semantic.json", "habitat/info_semantic.json"}) {
      if (fs::exists(place / name)) return read_replica_classes(place / name);
    }
  }
  return std::nullopt;
}

core::CameraIntrinsics camera_of(const Rendering& rendering, const fs::path& folder,
                                 const ImageSize& size) {
  if (fs::exists(folder / "intrinsics.txt")) {
    return read_intrinsics(folder / "intrinsics.txt", size, 0.5);
  }
  const core::CameraIntrinsics& camera = rendering.camera;
  if (size != ImageSize{camera.width_px, camera.height_px}) {
    throw InputError::expected(
        (folder / rendering.color_folder).string(),
        "images of " + std::to_string(camera.width_px) + "x" +
            std::to_string(camera.height_px) + " pixels, or intrinsics.txt",
        std::to_string(size.width_px) + "x" + std::to_string(size.height_px));
  }
  return camera;
}

}  // namespace

bool looks_like_replica(const fs::path& folder) { return rendering_of(folder) != nullptr; }

std::unique_ptr<RgbdSequence> open_replica(const fs::path& folder,
                                           const SequenceOptions& options) {
  const Rendering* rendering = rendering_of(folder);
  if (rendering == nullptr) {
    throw InputError::expected(folder.string(),
                               "traj_w_c.txt with rgb/, or traj.txt with results/", "neither");
  }
  const auto colors = numbered_files(folder / rendering->color_folder, rendering->color_prefix,
                                     {".png", ".jpg"});
  const auto depths =
      numbered_files(folder / rendering->depth_folder, rendering->depth_prefix, {".png"});
  const fs::path pose_file = folder / rendering->poses;
  const std::vector<NumberLine> poses = read_number_lines(pose_file);

  SequenceParts parts;
  parts.name = sequence_name(folder);
  parts.depth_unit_m = rendering->depth_unit_m;
  const fs::path semantic = folder / "semantic_class", instance = folder / "semantic_instance";
  if (fs::is_directory(semantic) && fs::is_directory(instance)) {
    parts.label_map = choose_label_map(
        options, [&] { return replica_classes(folder); }, parts.warnings);
    parts.has_masks = parts.label_map.has_value();
  }
  for (const auto& color : colors) {
    const std::int64_t number =
        color.first;  // Clang before 16 captures no structured binding.
    FrameFiles frame;
    frame.name = color.second.stem().string();
    frame.rgb = color.second;
    const auto index = static_cast<std::size_t>(number);
    if (accept_frame(options.on_bad_frame, frame.name, parts.warnings, [&] {
          if (index >= poses.size()) {
            throw InputError::expected(pose_file.string(),
                                       "a line for image " + std::to_string(number),
                                       std::to_string(poses.size()) + " lines");
          }
          const std::string place =
              pose_file.string() + ":" + std::to_string(poses[index].line);
          frame.T_world_camera = pose_from_matrix(poses[index].numbers, place);
          frame.depth_png = file_of(depths, number,
                                    folder / rendering->depth_folder /
                                        (rendering->depth_prefix + std::to_string(number)));
          if (!parts.has_masks) return;
          const std::string n = std::to_string(number) + ".png";
          frame.semantic = semantic / ("semantic_class_" + n);
          frame.instance = instance / ("semantic_instance_" + n);
        })) {
      parts.frames.push_back(std::move(frame));
    }
  }
  parts.intrinsics = camera_of(*rendering, folder, first_image_size(parts.frames, folder));
  parts.notes.push_back(std::string("layout: replica, rendering of ") + rendering->name);
  return finish_sequence(std::move(parts), folder, convention_of(options, UpAxis::kZ),
                         options.on_bad_frame);
}

}  // namespace segsim::reconstruction::internal
