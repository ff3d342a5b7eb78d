/// @file
/// frame-NNNNNN.color.{png,jpg}, .depth.png (uint16 millimetres) and .pose.txt (4x4
/// camera-to-world) with intrinsics.txt beside them: the layout of Microsoft's 7-Scenes
/// (Shotton et al., CVPR 2013), which `segsim capture` writes too, with masks, float depth and
/// labels.yaml.

#include <map>
#include <regex>
#include <set>

#include "core/error.h"
#include "reconstruction/datasets/internal/calibration_files.h"
#include "reconstruction/datasets/internal/file_sequence.h"
#include "reconstruction/datasets/labels_file.h"

namespace segsim::reconstruction::internal {
namespace {

namespace fs = std::filesystem;
using core::InputError;

/// "frame-000012" -> its files by suffix ("color.png", "pose.txt", ...).
using FrameTable = std::map<std::string, std::map<std::string, fs::path>>;

FrameTable list_frames(const fs::path& folder) {
  static const std::regex pattern(
      R"((frame-\d+)\.(color\.png|color\.jpg|depth\.png|depth\.exr|pose\.txt|semantic\.png|instance\.png))");
  FrameTable table;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    std::smatch match;
    if (std::regex_match(name, match, pattern)) table[match[1]][match[2]] = entry.path();
  }
  return table;
}

/// Path of the first suffix that exists; empty if none does.
fs::path find_one(const std::map<std::string, fs::path>& files,
                  std::initializer_list<const char*> suffixes) {
  for (const char* suffix : suffixes) {
    if (const auto found = files.find(suffix); found != files.end()) return found->second;
  }
  return {};
}

fs::path require_one(const std::map<std::string, fs::path>& files, const fs::path& stem,
                     std::initializer_list<const char*> suffixes) {
  fs::path found = find_one(files, suffixes);
  if (!found.empty()) return found;
  std::string wanted;
  for (const char* suffix : suffixes)
    wanted += (wanted.empty() ? "" : " or ") + std::string(suffix);
  throw InputError::expected(stem.string(),
                             "a file " + stem.filename().string() + "." + wanted, "none");
}

FrameFiles read_frame(const std::string& name, const std::map<std::string, fs::path>& files,
                      const fs::path& folder, bool has_masks) {
  const fs::path stem = folder / name;
  FrameFiles frame;
  frame.name = name;
  frame.rgb = require_one(files, stem, {"color.png", "color.jpg"});
  frame.depth_exr = find_one(files, {"depth.exr"});
  if (frame.depth_exr.empty()) frame.depth_png = require_one(files, stem, {"depth.png"});
  const fs::path pose_file = require_one(files, stem, {"pose.txt"});
  std::vector<double> numbers;
  for (const NumberLine& line : read_number_lines(pose_file)) {
    numbers.insert(numbers.end(), line.numbers.begin(), line.numbers.end());
  }
  frame.T_world_camera = pose_from_matrix(numbers, pose_file.string());
  if (has_masks) {
    frame.semantic = require_one(files, stem, {"semantic.png"});
    frame.instance = require_one(files, stem, {"instance.png"});
  }
  return frame;
}

fs::path intrinsics_file(const fs::path& folder) {
  for (const char* name : {"intrinsics.txt", "camera-intrinsics.txt"}) {
    if (fs::exists(folder / name)) return folder / name;
  }
  throw InputError::expected((folder / "intrinsics.txt").string(),
                             "the camera matrix (or camera-intrinsics.txt)", "no such file");
}

}  // namespace

bool looks_like_seven_scenes(const fs::path& folder) {
  for (const auto& [name, files] : list_frames(folder)) {
    if (files.contains("pose.txt")) return true;
  }
  return false;
}

std::unique_ptr<RgbdSequence> open_seven_scenes(const fs::path& folder,
                                                const SequenceOptions& options) {
  const FrameTable table = list_frames(folder);
  if (table.empty()) {
    throw InputError::expected(folder.string(), "files frame-NNNNNN.color.png", "none");
  }
  SequenceParts parts;
  parts.name = sequence_name(folder);

  WorldConvention convention = convention_of(options, UpAxis::kZ);
  double center_offset_px = 0.5;
  const fs::path labels_path = folder / "labels.yaml";
  if (fs::exists(labels_path)) {
    SequenceLabels labels = read_sequence_labels(labels_path);
    parts.classes = std::move(labels.classes);
    parts.instances = std::move(labels.instances);
    parts.crowds = std::move(labels.crowds);
    parts.has_masks = !parts.classes.empty();
    center_offset_px = 0.5 - labels.pixel_center;
    convention.up = labels.up;
    convention.fit_floor = false;
    convention.floor_height_m.reset();
    convention.floor_points_m.clear();
    convention.gravity.reset();
    convention.up_given = false;
    parts.notes.push_back("labels.yaml: " + labels.source);
  } else if (!find_one(table.begin()->second, {"semantic.png", "instance.png"}).empty()) {
    parts.warnings.emplace_back("masks without labels.yaml are ignored");
  }
  parts.notes.emplace_back(center_offset_px > 0.0
                               ? "layout: 7scenes; integer pixel centres assumed: 0.5 px added"
                               : "layout: 7scenes; pixel centres at +0.5");

  for (const auto& entry : table) {
    (void)accept_frame(options.on_bad_frame, entry.first, parts.warnings, [&] {
      parts.frames.push_back(read_frame(entry.first, entry.second, folder, parts.has_masks));
    });
  }
  parts.intrinsics = read_intrinsics(intrinsics_file(folder),
                                     first_image_size(parts.frames, folder), center_offset_px);
  return finish_sequence(std::move(parts), folder, convention, options.on_bad_frame);
}

}  // namespace segsim::reconstruction::internal
