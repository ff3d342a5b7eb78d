/// @file
/// ScanNet++ (Yeshwanth et al., ICCV 2023), a scene's folder. Poses are those of colmap/: they
/// share the metric frame of the meshes (z up), which nerfstudio/transforms.json does not.
///
///     dslr/colmap/{cameras, images}.txt
///     dslr/resized_undistorted_images/<name>.JPG with nerfstudio/transforms_undistorted.json,
///     else dslr/resized_images/<name>.JPG, fisheye, straightened here
///     dslr/resized_undistorted_masks/ or resized_anon_masks/<name>.png     255 = valid
///     iphone/rgb/<name>.jpg, iphone/depth/<name>.png (uint16 mm), iphone/rgb_masks/<name>.png
///
/// The DSLR has no depth and the scene no label images: both are renderings of the mesh, read
/// if they are there, of the images' size: <camera>/render_depth/<name>.png (uint16
/// millimetres), <camera>/semantic/ and <camera>/instance/<name>.png; instance ids above 10000
/// mean none.

#include <set>

#include "core/error.h"
#include "reconstruction/datasets/internal/colmap_files.h"
#include "reconstruction/datasets/internal/file_sequence.h"
#include "reconstruction/datasets/internal/json_file.h"
#include "reconstruction/datasets/internal/listing.h"

namespace segsim::reconstruction::internal {
namespace {

namespace fs = std::filesystem;
using core::InputError;

constexpr std::uint16_t kLastInstance = 10000;

/// The part of a scene that is read: DSLR first.
std::optional<fs::path> camera_folder(const fs::path& scene) {
  for (const char* name : {"dslr", "iphone"}) {
    if (has_colmap_model(scene / name / "colmap")) return scene / name;
  }
  return std::nullopt;
}

struct Pictures {
  fs::path images, masks;
  Lens lens;
  std::string note;
};

Lens undistorted_lens(const fs::path& file) {
  const JsonNode root = JsonNode::load(file);
  Lens lens;
  lens.camera = {static_cast<int>(root.child("w").as_integer(1, 100000)),
                 static_cast<int>(root.child("h").as_integer(1, 100000)),
                 root.number("fl_x"),
                 root.number("fl_y"),
                 root.number("cx"),
                 root.number("cy")};
  return lens;
}

Pictures pictures_of(const fs::path& folder, const ColmapModel& model) {
  const fs::path undistorted = folder / "nerfstudio/transforms_undistorted.json";
  if (fs::is_directory(folder / "resized_undistorted_images") && fs::exists(undistorted)) {
    return {folder / "resized_undistorted_images", folder / "resized_undistorted_masks",
            undistorted_lens(undistorted), "undistorted DSLR images"};
  }
  const bool dslr = folder.filename() == "dslr";
  const fs::path images = folder / (dslr ? "resized_images" : "rgb");
  if (!fs::is_directory(images)) {
    throw InputError::expected(images.string(), "the pictures of the camera",
                               "no such folder");
  }
  return {images, folder / (dslr ? "resized_anon_masks" : "rgb_masks"),
          common_lens(model, folder / "colmap"),
          dslr ? "fisheye DSLR images" : "iPhone images"};
}

/// Names of the frames that the data set itself calls bad.
std::set<std::string> bad_frames(const fs::path& folder) {
  std::set<std::string> bad;
  const fs::path file = folder / "nerfstudio/transforms.json";
  if (!fs::exists(file)) return bad;
  const JsonNode root = JsonNode::load(file);
  for (const char* list : {"frames", "test_frames"}) {
    if (!root.has(list)) continue;
    const JsonNode frames = root.child(list);
    for (std::size_t i = 0; i < frames.size(); ++i) {
      const JsonNode frame = frames.at(i);
      if (frame.has("is_bad") && frame.child("is_bad").as_flag()) {
        bad.insert(frame.text("file_path"));
      }
    }
  }
  return bad;
}

}  // namespace

bool looks_like_scannetpp(const fs::path& folder) { return camera_folder(folder).has_value(); }

std::unique_ptr<RgbdSequence> open_scannetpp(const fs::path& folder,
                                             const SequenceOptions& options) {
  const std::optional<fs::path> camera = camera_folder(folder);
  if (!camera) {
    throw InputError::expected(folder.string(),
                               "dslr/colmap/ or iphone/colmap/ with cameras and images",
                               "a folder without");
  }
  const ColmapModel model = read_colmap_model(*camera / "colmap");
  const Pictures pictures = pictures_of(*camera, model);
  const std::set<std::string> bad = bad_frames(*camera);

  SequenceParts parts;
  parts.name = sequence_name(folder);
  parts.lens = pictures.lens;
  parts.last_instance = kLastInstance;
  if (fs::is_directory(*camera / "semantic") && fs::is_directory(*camera / "instance")) {
    parts.label_map = choose_label_map(
        options, [] { return std::nullopt; }, parts.warnings);
    parts.has_masks = parts.label_map.has_value();
  }
  const char* depth = camera->filename() == "iphone" ? "depth" : "render_depth";
  std::size_t left_out = 0;
  for (const ColmapImage& image : model.images) {
    if (bad.contains(image.name)) {
      ++left_out;
      continue;
    }
    const auto beside = [&](const fs::path& where) {
      return existing(where / image.name, {".png"}).value_or("");
    };
    FrameFiles frame;
    frame.name = fs::path(image.name).stem().string();
    frame.rgb = pictures.images / image.name;
    frame.T_world_camera = image.T_world_camera;
    frame.depth_png = beside(*camera / depth);
    frame.valid = beside(pictures.masks);
    if (parts.has_masks) {
      frame.semantic = *camera / "semantic" / (frame.name + ".png");
      frame.instance = *camera / "instance" / (frame.name + ".png");
    }
    parts.frames.push_back(std::move(frame));
  }
  if (left_out > 0) {
    parts.notes.push_back(std::to_string(left_out) + " frames marked is_bad left out");
  }
  parts.notes.push_back("layout: scannetpp, " + pictures.note + "; poses of colmap/");
  return finish_sequence(std::move(parts), folder, convention_of(options, UpAxis::kZ),
                         options.on_bad_frame);
}

}  // namespace segsim::reconstruction::internal
