/// @file
/// ScanNet v2 (Dai et al., CVPR 2017) as its SensReader exports a .sens file:
///
///     color/<n>.jpg              1296 x 968
///     depth/<n>.png              640 x 480, uint16 millimetres, 0 = none
///     pose/<n>.txt               4 x 4 camera-to-world, x right, y down, z forward; -inf
///     where
///                                tracking was lost
///     intrinsic/intrinsic_color.txt, intrinsic_depth.txt   4 x 4, integer pixel centres
///     label-filt/<n>.png         optional: 16 bit, raw ScanNet label
///     instance-filt/<n>.png      optional: 8 bit, objectId + 1
///     ../../scannetv2-labels.combined.tsv    optional: raw label -> NYU40
///
/// The world is in metres, z up.

#include <cmath>

#include "core/error.h"
#include "reconstruction/datasets/internal/calibration_files.h"
#include "reconstruction/datasets/internal/file_sequence.h"
#include "reconstruction/datasets/internal/listing.h"

namespace segsim::reconstruction::internal {
namespace {

namespace fs = std::filesystem;
using core::InputError;

std::optional<LabelMap> scannet_table(const fs::path& folder) {
  // Beside the scan, or in the data set's root: <root>/scans/<scan>.
  fs::path place = fs::absolute(folder / "x").lexically_normal().parent_path();
  for (int up = 0; up < 3; ++up, place = place.parent_path()) {
    for (const char* name : {"scannetv2-labels.combined.tsv", "scannet-labels.combined.tsv"}) {
      if (fs::exists(place / name)) return read_scannet_table(place / name);
    }
  }
  return std::nullopt;
}

/// Tracking was lost: the file is intact, but there is no pose.
bool is_lost(const std::vector<double>& pose) {
  return !pose.empty() && std::all_of(pose.begin(), pose.end(),
                                      [](double value) { return !std::isfinite(value); });
}

std::vector<double> read_pose(const fs::path& file) {
  std::vector<double> numbers;
  for (const NumberLine& line : read_number_lines(file)) {
    numbers.insert(numbers.end(), line.numbers.begin(), line.numbers.end());
  }
  return numbers;
}

void read_frames(const fs::path& folder, const SequenceOptions& options,
                 SequenceParts& parts) {
  const auto colors = numbered_files(folder / "color", "", {".jpg", ".png"});
  const auto depths = numbered_files(folder / "depth", "", {".png"});
  std::size_t lost = 0;
  for (const auto& color : colors) {
    const std::int64_t number =
        color.first;  // Clang before 16 captures no structured binding.
    FrameFiles frame;
    frame.name = std::to_string(number);
    frame.rgb = color.second;
    bool tracked = true;
    const bool accepted = accept_frame(options.on_bad_frame, frame.name, parts.warnings, [&] {
      frame.depth_png = file_of(depths, number, folder / "depth" / (frame.name + ".png"));
      const fs::path pose_file = folder / "pose" / (frame.name + ".txt");
      const std::vector<double> pose = read_pose(pose_file);
      tracked = !is_lost(pose);
      if (tracked) frame.T_world_camera = pose_from_matrix(pose, pose_file.string());
      if (!parts.has_masks) return;
      frame.semantic = folder / "label-filt" / (frame.name + ".png");
      frame.instance = folder / "instance-filt" / (frame.name + ".png");
    });
    if (!tracked) ++lost;
    if (accepted && tracked) parts.frames.push_back(std::move(frame));
  }
  if (lost > 0) {
    parts.notes.push_back(std::to_string(lost) + " frames without tracking left out");
  }
}

}  // namespace

bool looks_like_scannet(const fs::path& folder) {
  return fs::is_directory(folder / "color") && fs::is_directory(folder / "pose") &&
         fs::is_directory(folder / "intrinsic");
}

std::unique_ptr<RgbdSequence> open_scannet(const fs::path& folder,
                                           const SequenceOptions& options) {
  if (!looks_like_scannet(folder)) {
    throw InputError::expected(
        folder.string(), "color/, depth/, pose/ and intrinsic/, as SensReader exports them",
        "a folder without");
  }
  SequenceParts parts;
  parts.name = sequence_name(folder);
  if (fs::is_directory(folder / "label-filt") && fs::is_directory(folder / "instance-filt")) {
    parts.label_map = choose_label_map(
        options, [&] { return scannet_table(folder); }, parts.warnings);
    parts.has_masks = parts.label_map.has_value();
  }
  read_frames(folder, options, parts);
  const fs::path intrinsic = folder / "intrinsic";
  parts.intrinsics = read_intrinsics(intrinsic / "intrinsic_color.txt",
                                     first_image_size(parts.frames, folder), 0.5);
  if (!parts.frames.empty() && fs::exists(parts.frames.front().depth_png)) {
    parts.depth_camera =
        read_intrinsics(intrinsic / "intrinsic_depth.txt",
                        check_image_file(parts.frames.front().depth_png), 0.5);
  }
  parts.notes.emplace_back(
      "layout: scannet; integer pixel centres: 0.5 px added; depth brought to the colour "
      "view");
  return finish_sequence(std::move(parts), folder, convention_of(options, UpAxis::kZ),
                         options.on_bad_frame);
}

}  // namespace segsim::reconstruction::internal
