#include <charconv>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/render.h"
#include "core/scene_bundle.h"
#include "experiments/commands/commands.h"
#include "experiments/commands/light/flag_values.h"
#include "experiments/drawing/frame_picture.h"
#include "experiments/reproducibility/backend_warning.h"
#include "experiments/scenes/viewed_place.h"
#include "perception/data/image_file.h"
#include "renderer/files/exr_io.h"
#include "renderer/reference_renderer.h"
#include "renderer/renderer_backend.h"
#include "renderer/scene/render_options.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

struct Flags {
  fs::path scene, out;
  std::vector<double> pose{0.0, 0.0, 1.2, 0.0, 0.0};
  std::int64_t view = -1;  ///< >= 0: a camera of the recording instead of `pose` and sizes.
  int width_px = 640, height_px = 480;
  double hfov_deg = 70.0;
  renderer::RenderOptions options;
  std::string backend = "cpu";
  bool reference = false;
  bool single_part = false;
};

/// Turns "all" into kAllSurfels and lets 1 ... kMaxTopK pass.
CLI::Validator top_k_validator() {
  const std::string range = "1 ... " + std::to_string(renderer::kMaxTopK) + " or all";
  return CLI::Validator(
      [range](std::string& value) -> std::string {
        if (value == "all") {
          value = std::to_string(renderer::kAllSurfels);
          return {};
        }
        int count = 0;
        const char* end = value.data() + value.size();
        const auto [parsed, error] = std::from_chars(value.data(), end, count);
        const bool valid =
            error == std::errc() && parsed == end && count >= 1 && count <= renderer::kMaxTopK;
        return valid ? std::string() : "expected " + range + ", found " + value;
      },
      range);
}

template <class Enum>
std::string choices(const std::map<std::string, Enum>& names) {
  std::string text;
  for (const auto& [name, value] : names) text += (text.empty() ? "" : "|") + name;
  return text;
}

/// A flag whose values have names.
template <class Enum>
void add_choice(CLI::App& command, const std::string& flag, Enum& value,
                const std::map<std::string, Enum>& names, const std::string& help) {
  std::string default_name;
  for (const auto& [name, named] : names) {
    if (named == value) default_name = name;
  }
  const auto to_number = [names](std::string& text) -> std::string {
    const auto found = names.find(text);
    if (found == names.end()) return "expected " + choices(names) + ", found " + text;
    text = std::to_string(static_cast<int>(found->second));
    return {};
  };
  command.add_option(flag, value, help)
      ->transform(CLI::Validator(to_number, ""))
      ->option_text(choices(names) + "=" + default_name);
}

/// What a bundle adds to the images that are written; a bare surfel file has no names.
renderer::FrameInfo frame_info(const std::optional<core::SceneBundle>& bundle) {
  renderer::FrameInfo info;
  if (!bundle) return info;
  info.scene = bundle->manifest.name;
  info.scene_sha256 = bundle->scene_sha256;
  info.names =
      std::make_shared<const renderer::SceneNames>(renderer::SceneNames::of(bundle->manifest));
  return info;
}

core::CameraPose camera_pose(const std::vector<double>& pose) {
  constexpr double kDegree = std::numbers::pi / 180.0;
  const core::Pose2 base{pose[0], pose[1], pose[3] * kDegree};
  return core::transform_from_pose2<core::frame::World>(base) *
         core::mast_camera(pose[2], pose[4] * kDegree);
}

/// Where the picture is taken from, and with what.
std::pair<core::CameraPose, core::CameraIntrinsics> camera(const Flags& flags,
                                                           const scenes::ViewedPlace& place) {
  if (flags.view < 0) {
    return {camera_pose(flags.pose),
            core::CameraIntrinsics::from_fov(flags.width_px, flags.height_px,
                                             flags.hfov_deg * std::numbers::pi / 180.0)};
  }
  const auto& view =
      scenes::recorded_view(place, flags.scene, static_cast<std::size_t>(flags.view));
  return {view.T_world_camera, place.cameras->intrinsics};
}

void render(const Flags& flags) {
  const scenes::ViewedPlace place = scenes::open_viewed_place(flags.scene);
  const scenes::SceneSurfels& scene = place.scene;
  const auto renderer =
      flags.reference ? renderer::make_reference_renderer(scene.surfels, flags.options)
                      : renderer::make_renderer(renderer::backend_of(flags.backend),
                                                scene.surfels, flags.options, scene.labels,
                                                reproducibility::warn_about_backend);
  const auto [T_world_camera, intrinsics] = camera(flags, place);
  const core::Frame frame = renderer->render(T_world_camera, intrinsics, core::Channels::kAll);

  const std::string extension = flags.out.extension().string();
  if (extension == ".exr") {
    renderer::ExrOptions options;
    if (flags.single_part) options.layout = renderer::ExrLayout::kSinglePart;
    renderer::write_frame_exr(flags.out, frame, frame_info(place.bundle), options);
  } else if (extension == ".png" || extension == ".jpg") {
    perception::write_image(flags.out, drawing::frame_picture(frame));
  } else {
    throw core::InputError::expected("--out", "a name that ends in .exr, .png or .jpg",
                                     flags.out.string());
  }
  std::printf("%s: %zu surfels, %llu on screen, %llu tile pairs, %.1f ms\n",
              flags.out.string().c_str(), scene.surfels->size(),
              static_cast<unsigned long long>(frame.stats.surfels_projected),
              static_cast<unsigned long long>(frame.stats.pairs_binned),
              frame.stats.render_ms);
}

void add_strategy_flags(CLI::App& command, renderer::RenderOptions& options) {
  using renderer::Compat;
  using renderer::DepthMode;
  using renderer::TileBounds;
  using renderer::TopKRule;
  add_choice<Compat>(
      command, "--compat", options.compat,
      {{"exact", Compat::kExact}, {"inria", Compat::kInria}, {"gsplat", Compat::kGsplat}},
      "Rules for bounds, near plane, low pass and depth: ours, or those of the program that "
      "trained the scene (hbb1/diff-surfel-rasterization, gsplat)");
  add_choice<TileBounds>(command, "--bounds", options.bounds,
                         {{"aabb", TileBounds::kAabb},
                          {"snugbox", TileBounds::kSnugBox},
                          {"accutile", TileBounds::kAccuTile},
                          {"paper", TileBounds::kPaper}},
                         "Which surfels a tile looks at; with --compat=exact only");
  command
      .add_option("--top-k", options.top_k,
                  "Surfels that vote for a pixel's label: 1 ... 24, or all")
      ->transform(top_k_validator())
      ->capture_default_str();
  add_choice<TopKRule>(command, "--top-k-rule", options.top_k_rule,
                       {{"heaviest", TopKRule::kHeaviest}, {"first", TopKRule::kFirst}},
                       "Which of a pixel's surfels vote: the heaviest, or the first met");
  add_choice<DepthMode>(command, "--depth", options.depth,
                        {{"median", DepthMode::kMedian}, {"expected", DepthMode::kExpected}},
                        "Depth of the surface, or the mean weighted by opacity");
  command.add_option("--threads", options.threads, "Threads; 0 = all processors")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
}

}  // namespace

void add_render_command(CLI::App& app) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = light::add_listed(app, light::kCommands, "render");
  command
      ->add_option("scene", flags->scene,
                   "Bundle folder, OUT.training of an unfinished training, or surfels in the "
                   "2DGS PLY layout")
      ->required();
  command
      ->add_option("--out", flags->out,
                   "view.exr: R, G, B, A, Z, N.x, N.y, N.z, semantic, instance, Cryptomatte; "
                   "view.png: colour, depth, normals and panoptic image side by side")
      ->required();
  CLI::Option* pose =
      command
          ->add_option("--pose", flags->pose,
                       "Camera in the world: x y z [m], yaw, pitch down [degrees]")
          ->expected(5)
          ->check(light::coordinate())
          ->capture_default_str();
  command
      ->add_option("--view", flags->view,
                   "The recording's n-th camera, from 0, in its own size (cameras.txt)")
      ->check(CLI::Range(0, 100'000'000))
      ->excludes(pose);
  command->add_option("--width", flags->width_px, "Image width [px]")
      ->check(light::image_side())
      ->capture_default_str();
  command->add_option("--height", flags->height_px, "Image height [px]")
      ->check(light::image_side())
      ->capture_default_str();
  command->add_option("--hfov-deg", flags->hfov_deg, "Horizontal field of view [degrees]")
      ->check(light::field_of_view_deg())
      ->capture_default_str();
  add_strategy_flags(*command, flags->options);
  command->add_flag(
      "--single-part", flags->single_part,
      "EXR: all channels in one part, for programs that read the first part only");
  command->add_option("--backend", flags->backend, "cpu | cuda | auto")->capture_default_str();
  command->add_flag("--reference", flags->reference,
                    "Use the slow double-precision reference instead of the fast renderer");
  command->callback([flags] { render(*flags); });
}

}  // namespace segsim::experiments::commands
