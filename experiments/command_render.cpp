#include <cstdio>
#include <filesystem>
#include <memory>
#include <numbers>
#include <vector>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/render.h"
#include "core/scene_bundle.h"
#include "experiments/commands.h"
#include "experiments/frame_picture.h"
#include "perception/image_file.h"
#include "renderer/cpu_renderer.h"
#include "renderer/exr_io.h"
#include "renderer/ply_io.h"
#include "renderer/reference_renderer.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

struct Flags {
  fs::path scene, out;
  std::vector<double> pose{0.0, 0.0, 1.2, 0.0, 0.0};
  int width_px = 640, height_px = 480;
  double hfov_deg = 70.0;
  int top_k = 4;
  bool reference = false;
};

/// A bundle's folder or a bare surfel file.
fs::path surfels_file(const fs::path& scene) {
  if (scene.extension() == ".ply") return scene;
  return core::load_bundle(scene).surfels_file();
}

core::CameraPose camera_pose(const std::vector<double>& pose) {
  constexpr double kDegree = std::numbers::pi / 180.0;
  const core::Pose2 base{pose[0], pose[1], pose[3] * kDegree};
  return core::transform_from_pose2<core::frame::World>(base) *
         core::mast_camera(pose[2], pose[4] * kDegree);
}

void render(const Flags& flags) {
  auto surfels = std::make_shared<renderer::SurfelCloud>(
      renderer::read_surfels_ply(surfels_file(flags.scene)));
  renderer::RenderOptions options;
  options.top_k = flags.top_k;
  const auto renderer = flags.reference ? renderer::make_reference_renderer(surfels, options)
                                        : renderer::make_cpu_renderer(surfels, options);
  const auto intrinsics = core::CameraIntrinsics::from_fov(
      flags.width_px, flags.height_px, flags.hfov_deg * std::numbers::pi / 180.0);
  const core::Frame frame =
      renderer->render(camera_pose(flags.pose), intrinsics, core::Channels::kAll);

  const std::string extension = flags.out.extension().string();
  if (extension == ".exr") {
    renderer::write_frame_exr(flags.out, frame);
  } else if (extension == ".png" || extension == ".jpg") {
    perception::write_image(flags.out, frame_picture(frame));
  } else {
    throw core::InputError::expected("--out", "a name that ends in .exr, .png or .jpg",
                                     flags.out.string());
  }
  std::printf("%s: %zu surfels, %llu on screen, %llu tile pairs, %.1f ms\n",
              flags.out.string().c_str(), surfels->size(),
              static_cast<unsigned long long>(frame.stats.surfels_projected),
              static_cast<unsigned long long>(frame.stats.pairs_binned),
              frame.stats.render_ms);
}

}  // namespace

void add_render_command(CLI::App& app) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = app.add_subcommand(
      "render",
      "Render one view of a bundle or a 2DGS .ply: every channel to EXR, or a sheet");
  command
      ->add_option("scene", flags->scene, "Bundle folder, or surfels in the 2DGS PLY layout")
      ->required();
  command
      ->add_option("--out", flags->out,
                   "view.exr: R, G, B, A, Z, N.x, N.y, N.z, semantic, instance; "
                   "view.png: colour, depth, normals and panoptic image side by side")
      ->required();
  command
      ->add_option("--pose", flags->pose,
                   "Camera in the world: x y z [m], yaw, pitch down [degrees]")
      ->expected(5)
      ->capture_default_str();
  command->add_option("--width", flags->width_px, "Image width [px]")
      ->check(CLI::Range(8, 8192))
      ->capture_default_str();
  command->add_option("--height", flags->height_px, "Image height [px]")
      ->check(CLI::Range(8, 8192))
      ->capture_default_str();
  command->add_option("--hfov-deg", flags->hfov_deg, "Horizontal field of view [degrees]")
      ->check(CLI::Range(10.0, 170.0))
      ->capture_default_str();
  command->add_option("--top-k", flags->top_k, "Surfels that vote for a pixel's label")
      ->check(CLI::Range(1, 24))
      ->capture_default_str();
  command->add_flag("--reference", flags->reference,
                    "Use the slow double-precision reference instead of the fast renderer");
  command->callback([flags] { render(*flags); });
}

}  // namespace segsim::experiments
