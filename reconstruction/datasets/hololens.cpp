/// @file
/// rgb/NNNNN.jpg, depth/NNNNN.png (uint16 millimetres, registered to colour), K.txt (3x3) and
/// poses.txt: line i is the row-major camera-to-world of the i-th file in sorted order. +Y is
/// up. Written by the HoloLens recorder of the deep-video-mvs project (Duzceker et al., CVPR
/// 2021).

#include <algorithm>
#include <set>

#include "core/error.h"
#include "reconstruction/datasets/internal/calibration_files.h"
#include "reconstruction/datasets/internal/file_sequence.h"

namespace segsim::reconstruction::internal {
namespace {

namespace fs = std::filesystem;
using core::InputError;

/// Image files of a folder, sorted by name.
std::vector<fs::path> image_files(const fs::path& folder,
                                  const std::set<std::string>& suffixes) {
  if (!fs::is_directory(folder)) {
    throw InputError::expected(folder.string(), "a folder of images", "no such folder");
  }
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.is_regular_file() && suffixes.contains(entry.path().extension().string())) {
      files.push_back(entry.path());
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

void expect_pairs(const std::vector<fs::path>& rgb, const std::vector<fs::path>& depth,
                  const fs::path& folder) {
  if (rgb.size() != depth.size()) {
    throw InputError::expected(folder.string(), "as many depth as colour images",
                               std::to_string(rgb.size()) + " colour and " +
                                   std::to_string(depth.size()) + " depth images");
  }
  for (std::size_t i = 0; i < rgb.size(); ++i) {
    if (rgb[i].stem() != depth[i].stem()) {
      throw InputError::expected(depth[i].string(), "depth of " + rgb[i].filename().string(),
                                 depth[i].filename().string());
    }
  }
}

}  // namespace

bool looks_like_hololens(const fs::path& folder) {
  return fs::is_directory(folder / "rgb") && fs::is_directory(folder / "depth") &&
         fs::exists(folder / "poses.txt");
}

std::unique_ptr<RgbdSequence> open_hololens(const fs::path& folder,
                                            const SequenceOptions& options) {
  const std::vector<fs::path> rgb = image_files(folder / "rgb", {".jpg", ".jpeg", ".png"});
  const std::vector<fs::path> depth = image_files(folder / "depth", {".png"});
  expect_pairs(rgb, depth, folder);

  const fs::path pose_file = folder / "poses.txt";
  const std::vector<NumberLine> poses = read_number_lines(pose_file);
  if (poses.size() != rgb.size()) {
    throw InputError::expected(pose_file.string(),
                               std::to_string(rgb.size()) + " poses, one per image",
                               std::to_string(poses.size()) + " poses");
  }

  SequenceParts parts;
  parts.name = sequence_name(folder);
  for (std::size_t i = 0; i < rgb.size(); ++i) {
    FrameFiles frame;
    frame.name = rgb[i].stem().string();
    frame.rgb = rgb[i];
    frame.depth_png = depth[i];
    const std::string place = pose_file.string() + ":" + std::to_string(poses[i].line);
    if (accept_frame(options.on_bad_frame, frame.name, parts.warnings, [&] {
          frame.T_world_camera = pose_from_matrix(poses[i].numbers, place);
        })) {
      parts.frames.push_back(std::move(frame));
    }
  }
  parts.intrinsics =
      read_intrinsics(folder / "K.txt", first_image_size(parts.frames, folder), 0.5);
  parts.notes.emplace_back(
      "layout: hololens; K.txt means integer pixel centres: 0.5 px added");

  return finish_sequence(std::move(parts), folder, convention_of(options, UpAxis::kY),
                         options.on_bad_frame);
}

}  // namespace segsim::reconstruction::internal
