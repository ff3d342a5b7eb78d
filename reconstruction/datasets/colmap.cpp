/// @file
/// A COLMAP workspace: sparse/0/, sparse/ or colmap/ with {cameras, images}.{bin, txt}, and
/// the pictures in images/. Optional: depth/<name>.png (uint16 millimetres, in the model's
/// scale), masks/<name>.png (0 = ignore), points3D.{bin, txt} in the model (sparse points, a
/// help to stereo). All images must have one camera; its distortion is
/// removed.

#include "core/error.h"
#include "reconstruction/datasets/internal/colmap_files.h"
#include "reconstruction/datasets/internal/file_sequence.h"
#include "reconstruction/datasets/internal/listing.h"

namespace segsim::reconstruction::internal {
namespace {

namespace fs = std::filesystem;
using core::InputError;

std::optional<fs::path> model_folder(const fs::path& folder) {
  for (const char* name : {"sparse/0", "sparse", "colmap", "."}) {
    if (has_colmap_model(folder / name)) return folder / name;
  }
  return std::nullopt;
}

}  // namespace

bool looks_like_colmap(const fs::path& folder) {
  return model_folder(folder).has_value() && fs::is_directory(folder / "images");
}

std::unique_ptr<RgbdSequence> open_colmap(const fs::path& folder,
                                          const SequenceOptions& options) {
  const std::optional<fs::path> place = model_folder(folder);
  if (!place || !fs::is_directory(folder / "images")) {
    throw InputError::expected(folder.string(),
                               "sparse/0/ with cameras and images (.bin or .txt), and images/",
                               "a folder without");
  }
  const ColmapModel model = read_colmap_model(*place);
  SequenceParts parts;
  parts.name = sequence_name(folder);
  parts.sparse_points_m = model.points_m;
  parts.lens = common_lens(model, *place);
  for (const ColmapImage& image : model.images) {
    FrameFiles frame;
    frame.name = fs::path(image.name).stem().string();
    frame.rgb = folder / "images" / image.name;
    frame.T_world_camera = image.T_world_camera;
    frame.seen_points = image.seen_points;
    frame.depth_png = existing(folder / "depth" / image.name, {".png"}).value_or("");
    frame.valid = existing(folder / "masks" / image.name, {".png"}).value_or("");
    parts.frames.push_back(std::move(frame));
  }
  parts.notes.emplace_back(
      "layout: colmap; one unit of the model is taken as a metre, its z as up");
  return finish_sequence(std::move(parts), folder, convention_of(options, UpAxis::kZ),
                         options.on_bad_frame);
}

}  // namespace segsim::reconstruction::internal
