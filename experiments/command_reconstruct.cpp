#include <cstdio>
#include <filesystem>
#include <memory>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "experiments/commands.h"
#include "experiments/reconstruct.h"
#include "experiments/scene_source.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

struct Flags {
  fs::path sequence, boxes, label_map, out;
  std::string layout = "auto", up = "auto", on_bad_frame = "refuse", robot = "jackal-gentle";
  double floor_height_m = 0.0;
  bool floor_given = false;
  ReconstructOptions reconstruct;
};

void reconstruct(Flags flags) {
  renderer::SequenceOptions options;
  options.layout = renderer::parse_sequence_layout(flags.layout, "--layout");
  options.up_axis = renderer::parse_up_axis(flags.up, "--up");
  options.on_bad_frame = renderer::parse_on_bad_frame(flags.on_bad_frame, "--on-bad-frame");
  options.label_map = flags.label_map;
  if (flags.floor_given) options.floor_height_m = flags.floor_height_m;
  const auto sequence = open_recording(flags.sequence, flags.boxes, options);
  for (const std::string& note : sequence->notes()) std::printf("%s\n", note.c_str());

  flags.reconstruct.name = flags.out.filename().string();
  flags.reconstruct.source = "recording " + flags.sequence.filename().string();
  flags.reconstruct.robot = sim::RobotModel::by_name(flags.robot);
  const core::SceneBundle bundle = reconstruct_bundle(*sequence, flags.reconstruct, flags.out);
  std::printf("%s: %zu classes, %zu instances; see `segsim scene inspect`\n",
              flags.out.string().c_str(), bundle.manifest.classes.size(),
              bundle.manifest.instances.size());
}

}  // namespace

void add_reconstruct_command(CLI::App& app) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = app.add_subcommand(
      "reconstruct", "Make a scene bundle from posed RGB-D frames with masks (lifting)");
  command
      ->add_option("sequence", flags->sequence,
                   "Folder in one of the layouts of docs/datasets.md")
      ->required();
  command->add_option("--out", flags->out, "Bundle folder")->required();
  command->add_option("--boxes", flags->boxes,
                      "3-D boxes (JSON) that label a recording without masks");
  command->add_option("--label-map", flags->label_map,
                      "Classes of a data set's label images (YAML, docs/datasets.md)");
  command
      ->add_option(
          "--layout", flags->layout,
          "auto | hololens | 7scenes | scannet | scannetpp | replica | tum | nerfstudio | "
          "colmap")
      ->capture_default_str();
  command->add_option("--up", flags->up, "auto | y | z: the recording's axis that points up")
      ->capture_default_str();
  command
      ->add_option("--on-bad-frame", flags->on_bad_frame,
                   "refuse | skip: what a broken image or pose does")
      ->capture_default_str();
  command
      ->add_option("--floor-height", flags->floor_height_m,
                   "Floor along the up axis of the recording [m]; default: fitted")
      ->each([flags](const std::string&) { flags->floor_given = true; });
  renderer::LiftOptions& lift = flags->reconstruct.lift;
  command->add_option("--voxel", lift.voxel_m, "Spacing of the surfels [m]")
      ->check(CLI::Range(0.002, 0.5))
      ->capture_default_str();
  command->add_option("--frame-step", lift.frame_step, "Use every n-th frame")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command->add_option("--robot", flags->robot, "Whose free space is checked and meshed")
      ->capture_default_str();
  command
      ->add_option("--camera-height", flags->reconstruct.camera_height_m,
                   "Mast height that suits the recording [m]")
      ->capture_default_str();
  core::GeodeticOrigin& origin = flags->reconstruct.origin;
  command->add_option("--latitude", origin.latitude_deg, "Of the world origin [degrees]")
      ->capture_default_str();
  command->add_option("--longitude", origin.longitude_deg, "Of the world origin [degrees]")
      ->capture_default_str();
  command->add_option("--origin-height", origin.height_m, "Of the world origin [m]")
      ->capture_default_str();
  command->add_option("--origin-yaw", origin.yaw_rad, "From east to world +x [rad]")
      ->capture_default_str();
  command->callback([flags] { reconstruct(*flags); });
}

}  // namespace segsim::experiments
