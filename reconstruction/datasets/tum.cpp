/// @file
/// TUM RGB-D (Sturm et al., IROS 2012):
///
///     rgb.txt, depth.txt     "timestamp file" a line, # begins a comment
///     groundtruth.txt        "timestamp tx ty tz qx qy qz qw": camera-to-world, z up, metres
///     depth PNG              uint16, 5000 a metre, registered to colour
///
/// Each colour image takes the nearest depth image and pose, at most 0.02 s away; without one
/// it is left out. Intrinsics come from intrinsics.txt (fx fy cx cy [k1 k2 p1 p2 k3], integer
/// pixel centres), else from the camera that the folder's name tells: freiburg1, 2 or 3.

#include <cmath>
#include <sstream>

#include "core/error.h"
#include "core/file_io.h"
#include "reconstruction/datasets/internal/calibration_files.h"
#include "reconstruction/datasets/internal/file_sequence.h"
#include "reconstruction/datasets/internal/listing.h"

namespace segsim::reconstruction::internal {
namespace {

namespace fs = std::filesystem;
using core::InputError;

constexpr double kFarthest_s = 0.02;

struct Stamped {
  double time_s = 0.0;
  int line = 0;
  std::vector<std::string> words;  ///< Behind the time.
};

/// Lines "timestamp word ...", ascending by time.
std::vector<Stamped> read_stamped(const fs::path& file, std::size_t words) {
  std::istringstream text(core::read_file(file));
  std::vector<Stamped> entries;
  std::string line;
  for (int number = 1; std::getline(text, line); ++number) {
    std::istringstream cells(line.substr(0, line.find('#')));
    Stamped entry{0.0, number, {}};
    std::string time;
    if (!(cells >> time)) continue;
    char* end = nullptr;
    entry.time_s = std::strtod(time.c_str(), &end);
    const std::string place = file.string() + ":" + std::to_string(number);
    if (*end != '\0' || !std::isfinite(entry.time_s)) {
      throw InputError::expected(place, "a time in seconds", "'" + time + "'");
    }
    for (std::string word; cells >> word;) entry.words.push_back(word);
    if (entry.words.size() != words) {
      throw InputError::expected(place, std::to_string(words) + " words behind the time",
                                 std::to_string(entry.words.size()));
    }
    entries.push_back(std::move(entry));
  }
  std::stable_sort(entries.begin(), entries.end(),
                   [](const Stamped& a, const Stamped& b) { return a.time_s < b.time_s; });
  return entries;
}

/// nullptr if none is near enough.
const Stamped* nearest(const std::vector<Stamped>& entries, double time_s) {
  const Stamped* best = nullptr;
  const auto after =
      std::lower_bound(entries.begin(), entries.end(), time_s,
                       [](const Stamped& entry, double t) { return entry.time_s < t; });
  for (auto it = after == entries.begin() ? after : after - 1;
       it != entries.end() && it <= after; ++it) {
    const double distance_s = std::abs(it->time_s - time_s);
    if (distance_s > kFarthest_s) continue;
    if (best == nullptr || distance_s < std::abs(best->time_s - time_s)) best = &*it;
  }
  return best;
}

core::CameraPose pose_of(const Stamped& entry, const fs::path& file) {
  const std::string place = file.string() + ":" + std::to_string(entry.line);
  std::array<double, 7> n{};
  for (std::size_t i = 0; i < n.size(); ++i) {
    char* end = nullptr;
    n[i] = std::strtod(entry.words[i].c_str(), &end);
    if (*end != '\0' || !std::isfinite(n[i])) {
      throw InputError::expected(place, "a finite number", "'" + entry.words[i] + "'");
    }
  }
  return pose_from_quaternion(glm::dquat(n[6], n[3], n[4], n[5]), {n[0], n[1], n[2]}, place);
}

/// Of the poses that are intact: a broken one is a complaint about the frame that takes it.
PoseTrack track_of(const std::vector<Stamped>& poses, const fs::path& file) {
  std::vector<PoseTrack::Entry> entries;
  for (const Stamped& pose : poses) {
    try {
      entries.push_back({pose.time_s, pose_of(pose, file)});
    } catch (const InputError&) {
      continue;
    }
  }
  return PoseTrack(std::move(entries));
}

/// As the data set's documentation gives them: fx fy cx cy k1 k2 p1 p2 k3.
std::vector<double> camera_numbers(const fs::path& folder, const std::string& name) {
  const fs::path file = folder / "intrinsics.txt";
  if (fs::exists(file)) {
    std::vector<double> numbers;
    for (const NumberLine& line : read_number_lines(file)) {
      numbers.insert(numbers.end(), line.numbers.begin(), line.numbers.end());
    }
    if (numbers.size() != 4 && numbers.size() != 9) {
      throw InputError::expected(file.string(), "fx fy cx cy, or these and k1 k2 p1 p2 k3",
                                 std::to_string(numbers.size()) + " numbers");
    }
    numbers.resize(9, 0.0);
    return numbers;
  }
  const auto is = [&](const char* camera) { return name.find(camera) != std::string::npos; };
  if (is("freiburg1"))
    return {517.3, 516.5, 318.6, 255.3, 0.2624, -0.9531, -0.0054, 0.0026, 1.1633};
  if (is("freiburg2"))
    return {520.9, 521.0, 325.1, 249.7, 0.2312, -0.7849, -0.0033, -0.0001, 0.9172};
  if (is("freiburg3")) return {535.4, 539.2, 320.1, 247.6, 0.0, 0.0, 0.0, 0.0, 0.0};
  throw InputError::expected(
      file.string(), "the camera (or freiburg1, 2 or 3 in the folder's name)", "no such file");
}

Lens lens_of(const std::vector<double>& n, const ImageSize& size) {
  Lens lens;
  lens.model = LensModel::kBrown;
  lens.camera = {size.width_px, size.height_px, n[0], n[1], n[2] + 0.5, n[3] + 0.5};
  lens.k = {n[4], n[5], n[8], 0.0};
  lens.p1 = n[6], lens.p2 = n[7];
  return lens;
}

}  // namespace

bool looks_like_tum(const fs::path& folder) {
  return fs::exists(folder / "rgb.txt") && fs::exists(folder / "depth.txt") &&
         fs::exists(folder / "groundtruth.txt");
}

std::unique_ptr<RgbdSequence> open_tum(const fs::path& folder,
                                       const SequenceOptions& options) {
  const std::vector<Stamped> colors = read_stamped(folder / "rgb.txt", 1);
  const std::vector<Stamped> depths = read_stamped(folder / "depth.txt", 1);
  const fs::path pose_file = folder / "groundtruth.txt";
  const std::vector<Stamped> poses = read_stamped(pose_file, 7);

  SequenceParts parts;
  parts.name = sequence_name(folder);
  parts.depth_unit_m = 1.0 / 5000.0;
  std::size_t alone = 0;
  for (const Stamped& color : colors) {
    const Stamped* depth = nearest(depths, color.time_s);
    const Stamped* pose = nearest(poses, color.time_s);
    if (depth == nullptr || pose == nullptr) {
      ++alone;
      continue;
    }
    FrameFiles frame;
    frame.rgb = folder / color.words[0];
    frame.name = frame.rgb.stem().string();
    frame.time_s = color.time_s;
    frame.depth_png = folder / depth->words[0];
    frame.depth_time_s = depth->time_s;
    if (accept_frame(options.on_bad_frame, frame.name, parts.warnings,
                     [&] { frame.T_world_camera = pose_of(*pose, pose_file); })) {
      parts.frames.push_back(std::move(frame));
    }
  }
  parts.track = track_of(poses, pose_file);
  if (alone > 0) {
    parts.notes.push_back(std::to_string(alone) +
                          " colour images without depth or pose within 0.02 s left out");
  }
  parts.lens =
      lens_of(camera_numbers(folder, parts.name), first_image_size(parts.frames, folder));
  parts.notes.emplace_back("layout: tum; integer pixel centres: 0.5 px added");
  return finish_sequence(std::move(parts), folder, convention_of(options, UpAxis::kZ),
                         options.on_bad_frame);
}

}  // namespace segsim::reconstruction::internal
