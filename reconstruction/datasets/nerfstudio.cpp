/// @file
/// nerfstudio's transforms.json (Tancik et al. 2023): intrinsics for all frames or in each
/// frame, `frames[]` with file_path, transform_matrix (camera-to-world, camera axes of
/// OpenGL), optional depth_file_path (uint16 millimetres) and mask_path (black = ignore).
/// Pixel centres are at + 0.5. The world is taken as it is: neither re-centred nor re-scaled.

#include <cmath>

#include "core/error.h"
#include "reconstruction/datasets/internal/calibration_files.h"
#include "reconstruction/datasets/internal/file_sequence.h"
#include "reconstruction/datasets/internal/json_file.h"

namespace segsim::reconstruction::internal {
namespace {

namespace fs = std::filesystem;
using core::InputError;

/// A number of the frame, else of the file.
double value_of(const JsonNode& frame, const JsonNode& root, const std::string& key) {
  return frame.has(key) ? frame.number(key) : root.number(key);
}
double value_or(const JsonNode& frame, const JsonNode& root, const std::string& key,
                double fallback) {
  return frame.has(key) ? frame.number(key) : root.number_or(key, fallback);
}

LensModel model_of(const JsonNode& frame, const JsonNode& root) {
  const JsonNode& node = frame.has("camera_model") ? frame : root;
  if (!node.has("camera_model")) return LensModel::kBrown;
  const std::string word = node.text("camera_model");
  if (word == "OPENCV_FISHEYE") return LensModel::kFisheye;
  if (word == "OPENCV" || word == "SIMPLE_RADIAL" || word == "RADIAL") {
    return LensModel::kBrown;
  }
  if (word == "PINHOLE" || word == "SIMPLE_PINHOLE") return LensModel::kPinhole;
  node.child("camera_model").fail("OPENCV, OPENCV_FISHEYE or PINHOLE", "'" + word + "'");
}

Lens lens_of(const JsonNode& frame, const JsonNode& root) {
  Lens lens;
  lens.model = model_of(frame, root);
  const double width_px = value_of(frame, root, "w"), height_px = value_of(frame, root, "h");
  constexpr double kLongestSide_px = 65535.0;
  if (!(width_px <= kLongestSide_px && height_px <= kLongestSide_px)) {
    root.fail("w and h up to 65535",
              std::to_string(width_px) + " and " + std::to_string(height_px));
  }
  lens.camera = {static_cast<int>(width_px),    static_cast<int>(height_px),
                 value_of(frame, root, "fl_x"), value_of(frame, root, "fl_y"),
                 value_of(frame, root, "cx"),   value_of(frame, root, "cy")};
  const auto term = [&](const char* key) { return value_or(frame, root, key, 0.0); };
  lens.k = {term("k1"), term("k2"), term("k3"), term("k4")};
  lens.p1 = term("p1"), lens.p2 = term("p2");
  if (lens.camera.fx_px <= 0.0 || lens.camera.fy_px <= 0.0) {
    root.fail("fl_x and fl_y > 0",
              std::to_string(lens.camera.fx_px) + " and " + std::to_string(lens.camera.fy_px));
  }
  if (lens.camera.width_px <= 0 || lens.camera.height_px <= 0) {
    root.fail("w and h > 0", std::to_string(lens.camera.width_px) + " and " +
                                 std::to_string(lens.camera.height_px));
  }
  return lens;
}

std::vector<double> matrix_of(const JsonNode& node) {
  std::vector<double> numbers;
  for (std::size_t row = 0; row < node.size(); ++row) {
    const JsonNode cells = node.at(row);
    for (std::size_t i = 0; i < cells.size(); ++i) numbers.push_back(cells.at(i).as_number());
  }
  if (numbers.size() != 16) {
    node.fail("4 rows of 4 numbers", std::to_string(numbers.size()) + " numbers");
  }
  return numbers;
}

FrameFiles frame_of(const JsonNode& node, const std::string& place, const fs::path& folder) {
  FrameFiles frame;
  frame.rgb = folder / node.text("file_path");
  frame.name = frame.rgb.stem().string();
  if (node.has("depth_file_path")) frame.depth_png = folder / node.text("depth_file_path");
  if (node.has("mask_path")) frame.valid = folder / node.text("mask_path");
  std::vector<double> matrix = matrix_of(node.child("transform_matrix"));
  turn_opengl_axes(matrix);
  frame.T_world_camera = pose_from_matrix(matrix, place + ".transform_matrix");
  return frame;
}

}  // namespace

bool looks_like_nerfstudio(const fs::path& folder) {
  return fs::exists(folder / "transforms.json");
}

std::unique_ptr<RgbdSequence> open_nerfstudio(const fs::path& folder,
                                              const SequenceOptions& options) {
  const fs::path file = folder / "transforms.json";
  const JsonNode root = JsonNode::load(file);
  const JsonNode frames = root.child("frames");
  if (!frames.is_list() || frames.size() == 0) frames.fail("a list of frames", "none");

  SequenceParts parts;
  parts.name = sequence_name(folder);
  std::optional<Lens> lens;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const JsonNode node = frames.at(i);
    const std::string place = file.string() + ": frames[" + std::to_string(i) + "]";
    if (!accept_frame(options.on_bad_frame, std::to_string(i), parts.warnings, [&] {
          FrameFiles frame = frame_of(node, place, folder);
          const Lens own = lens_of(node, root);
          if (!lens) lens = own;
          if (!(own == *lens)) {
            throw InputError::expected(place, "the camera of the first frame",
                                       "another camera");
          }
          parts.frames.push_back(std::move(frame));
        })) {
      continue;
    }
  }
  std::sort(parts.frames.begin(), parts.frames.end(),
            [](const FrameFiles& a, const FrameFiles& b) { return a.rgb < b.rgb; });
  parts.lens = lens;
  parts.notes.emplace_back("layout: nerfstudio; camera axes of OpenGL turned");
  return finish_sequence(std::move(parts), folder, convention_of(options, UpAxis::kZ),
                         options.on_bad_frame);
}

}  // namespace segsim::reconstruction::internal
