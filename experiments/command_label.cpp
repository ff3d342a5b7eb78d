#include <cstdio>
#include <filesystem>
#include <memory>
#include <numbers>

#include <CLI/CLI.hpp>

#include "core/scene_bundle.h"
#include "experiments/commands.h"
#include "experiments/view_labels.h"
#include "perception/dataset.h"
#include "sim/procedural_furniture.h"
#include "sim/robot.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

struct Flags {
  std::vector<fs::path> bundles;
  fs::path out;
  std::vector<std::string> classes = sim::goal_class_names();
  std::string robot = "jackal-gentle";
  int views = 200, width_px = 256, height_px = 192;
  std::uint64_t seed = 1;
  double hfov_deg = 79.0, camera_height_m = 0.0;
};

void label(const Flags& flags) {
  perception::CocoDataset all;
  for (const fs::path& folder : flags.bundles) {
    const core::SceneBundle bundle = core::load_bundle(folder);
    ViewLabelOptions options;
    options.seed = flags.seed;
    options.views = flags.views;
    options.camera = core::CameraIntrinsics::from_fov(
        flags.width_px, flags.height_px, flags.hfov_deg * std::numbers::pi / 180.0);
    options.camera_height_m =
        flags.camera_height_m > 0.0 ? flags.camera_height_m : bundle.manifest.camera_height_m;
    options.class_names = flags.classes;
    options.prefix = folder.filename().string() + "-";
    append_dataset(
        all, label_views(bundle, sim::RobotModel::by_name(flags.robot), options, flags.out));
  }
  perception::write_coco(flags.out / "labels.json", all);

  std::size_t boxes = 0, ignored = 0;
  for (const perception::LabeledImage& image : all.images) {
    for (const perception::LabeledBox& box : image.boxes) (box.ignore ? ignored : boxes) += 1;
  }
  std::printf("%s: %zu views, %zu boxes, %zu too hidden or too small to count\n",
              (flags.out / "labels.json").string().c_str(), all.images.size(), boxes, ignored);
}

}  // namespace

void add_label_command(CLI::App& app) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = app.add_subcommand(
      "label",
      "Render 3-D-consistent boxes from bundles, where the robot can be, to COCO JSON");
  command->add_option("bundles", flags->bundles, "Bundle folders")->required();
  command->add_option("--out", flags->out, "Folder for labels.json and images/")->required();
  command->add_option("--views", flags->views, "Views of each bundle")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command->add_option("--seed", flags->seed, "Chooses the views")->capture_default_str();
  command->add_option("--classes", flags->classes, "Class names to label")->delimiter(',');
  command->add_option("--robot", flags->robot, "Decides where the camera can be")
      ->capture_default_str();
  command->add_option("--camera-height", flags->camera_height_m,
                      "Camera height [m]; default: the bundle's");
  command->add_option("--width", flags->width_px, "Image width [px]")->capture_default_str();
  command->add_option("--height", flags->height_px, "Image height [px]")
      ->capture_default_str();
  command->add_option("--hfov-deg", flags->hfov_deg, "Horizontal field of view [degrees]")
      ->capture_default_str();
  command->callback([flags] { label(*flags); });
}

}  // namespace segsim::experiments
