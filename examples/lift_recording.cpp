// Turns a recording (colour, depth, masks, camera poses) into labelled surfels, without
// training.
//
//     lift_recording [RECORDING]
//
// RECORDING is a folder in one of the layouts that docs/datasets.md lists, in which every
// frame has depth. Without one the program first makes a recording itself: it walks a camera
// through a flat that is furnished from a seed. Writes into the current folder: lifted.ply
// (the surfels), photo.ppm (a frame that was held out) and rendered.ppm (the surfels, seen by
// the same camera).

#include <algorithm>
#include <cmath>
#include <iostream>

#include "core/error.h"
#include "examples/picture.h"
#include "reconstruction/datasets/rgbd_sequence.h"
#include "reconstruction/lifting/lifting.h"
#include "renderer/files/ply_io.h"
#include "renderer/renderer_backend.h"
#include "worlds/capture/capture.h"
#include "worlds/capture/capture_plan.h"
#include "worlds/capture/mesh_renderer.h"
#include "worlds/procedural/procedural_flat.h"

using namespace segsim;

namespace {

/// 150 frames of a procedural flat. Few rays for each colour, so that it takes seconds.
void make_recording(const std::filesystem::path& folder) {
  const sim::MeshScene flat = worlds::make_flat({.seed = 3});
  const auto camera = worlds::make_mesh_renderer(
      flat,
      {.samples_per_side = 1, .cell_m = 0.15F, .shadow_samples = 4, .bounce_samples = 9});
  worlds::capture_sequence(*camera, worlds::plan_capture_trajectory(flat, {.max_views = 150}),
                           core::CameraIntrinsics::from_fov(160, 120, 1.5), folder,
                           flat.classes, flat.instances, {.source = "flat 3", .on_frame = {}});
}

/// Median difference of two depth images where both have a value [m].
double median_difference_m(const core::Image<float>& a, const core::Image<float>& b) {
  std::vector<double> differences_m;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double difference_m = std::abs(a.pixels()[i] - b.pixels()[i]);
    if (std::isfinite(difference_m)) differences_m.push_back(difference_m);
  }
  if (differences_m.empty()) return std::nan("");
  std::ranges::nth_element(differences_m, differences_m.begin() + differences_m.size() / 2);
  return differences_m[differences_m.size() / 2];
}

/// Of the pixels with a class in the mask, the share that is rendered with that class.
double right_class_share(const core::Image<std::uint16_t>& mask,
                         const core::Image<std::uint16_t>& rendered) {
  int labelled = 0;
  int right = 0;
  for (std::size_t i = 0; i < mask.size(); ++i) {
    if (mask.pixels()[i] == 0) continue;
    ++labelled;
    if (mask.pixels()[i] == rendered.pixels()[i]) ++right;
  }
  return labelled == 0 ? std::nan("") : static_cast<double>(right) / labelled;
}

}  // namespace

int main(int argc, char** argv) try {
  const std::filesystem::path folder = argc > 1 ? argv[1] : "recording";
  if (argc < 2) make_recording(folder);

  // Every tenth frame, beginning with the first, is kept out of the surfels.
  const auto recording = reconstruction::open_sequence(folder);
  const reconstruction::LiftResult lifted =
      reconstruction::lift(*recording, {.voxel_m = 0.05, .held_out_every = 10});
  const auto surfels = std::make_shared<const renderer::SurfelCloud>(lifted.surfels);
  renderer::write_surfels_ply("lifted.ply", *surfels);

  const reconstruction::RgbdFrame photo = recording->load(0);
  const core::Frame frame =
      renderer::make_renderer(renderer::Backend::kCpu, surfels)
          ->render(photo.T_world_camera, recording->intrinsics(), core::Channels::kAll);
  examples::write_ppm("photo.ppm", photo.rgb);
  examples::write_ppm("rendered.ppm", frame.rgb);

  std::cout << "frames " << recording->frame_count() << "\nsurfels " << surfels->size()
            << "\ninstances " << lifted.instances.size() << "\nmedian_depth_difference_m "
            << median_difference_m(photo.depth_m, frame.depth_m) << "\nright_class_share "
            << right_class_share(photo.semantic, frame.semantic) << '\n';
  return 0;
} catch (const core::InputError& error) {
  std::cerr << "error: " << error.what() << '\n';
  return 2;
}
