// `segsim gazebo drive`: our perception and our policy in a running Gazebo. It is an
// experiment in one bundle whose robot Gazebo moves, so its rows are those of any other.
#include <cstdio>
#include <filesystem>
#include <memory>
#include <ostream>
#include <string>

#include <CLI/CLI.hpp>

#include "core/bundle_parts.h"
#include "core/file_io.h"
#include "core/formatted.h"
#include "core/scene_bundle.h"
#include "experiments/commands/bridges/bridge_commands.h"
#include "experiments/commands/bridges/bundle_spec.h"
#include "experiments/commands/run_flags.h"
#include "experiments/suites/layered_yaml.h"
#include "experiments/support/stop_signal.h"
#include "sim/gazebo/gazebo_drive.h"
#include "sim/gazebo/gazebo_world.h"

namespace segsim::experiments::commands::bridges {
namespace {

namespace fs = std::filesystem;

struct DriveFlags : BundleSpec {
  DriveFlags() {
    arm = "gazebo";
    detector = "oracle";
    rate_hz = 5.0;
    limit_s = 180.0;
    width_px = 256;
    height_px = 192;
    any_start = false;
  }

  fs::path work = "out/gazebo";
  std::string policy = "frontier";
  std::string world, model = "jackal", pose_topic, command_topic, flavour = "both";
  double wait_s = 30.0, most_lag_s = 1.0;
  bool new_run = false;
};

std::string spec_text(const DriveFlags& flags, const core::SceneManifest& scene) {
  std::string text = flags.text(scene) + "policy: " + suites::yaml_scalar(flags.policy) +
                     "\nclock: {mode: realtime}\nmotion:\n  type: gazebo\n  world: " +
                     suites::yaml_scalar(flags.world) +
                     "\n  model: " + suites::yaml_scalar(flags.model) +
                     "\n  flavour: " + flags.flavour + "\n";
  if (!flags.pose_topic.empty()) {
    text += "  pose_topic: " + suites::yaml_scalar(flags.pose_topic) + "\n";
  }
  if (!flags.command_topic.empty()) {
    text += "  command_topic: " + suites::yaml_scalar(flags.command_topic) + "\n";
  }
  return text +
         core::print("  patience_s: %g\n  most_lag_s: %g\n", flags.wait_s, flags.most_lag_s);
}

void drive(DriveFlags flags) {
  const core::SceneBundle bundle = core::load_bundle(flags.bundle);
  core::require_drivable(bundle);
  flags.check(bundle.manifest);
  if (flags.world.empty()) flags.world = sim::gazebo_world_name(bundle.manifest.name);
  RunFlags run;
  run.options.folders.work = flags.work;
  run.options.workers = 1;
  run.options.new_run = flags.new_run;
  const std::string text = spec_text(flags, bundle.manifest);
  const specs::ExperimentSpec spec =
      specs::parse_spec(text, "segsim gazebo drive", run.options.folders);
  const support::StopOnSignal signals;
  {
    sim::GazeboDriveOptions gazebo = *spec.motion;
    gazebo.interrupted = support::StopOnSignal::requested;
    std::printf("Gazebo: waiting for poses of \"%s\" in the world \"%s\"\n",
                gazebo.model.c_str(), gazebo.world.c_str());
    std::fflush(stdout);
    sim::GazeboDrive(gazebo).await_poses();
  }
  fs::create_directories(flags.work);
  const fs::path file = flags.work / "drive.yaml";
  core::write_file_atomically(file, [&](std::ostream& out) { out << text; });
  std::printf("The experiment: %s (segsim run %s --work %s --workers 1)\n", file.c_str(),
              file.c_str(), flags.work.c_str());
  check_end(run_and_print(spec, run));
}

void add_gazebo_flags(CLI::App& command, DriveFlags& flags) {
  command.add_option("--world", flags.world,
                     "Name of the world in topics; default: that of an exported world");
  command.add_option("--model", flags.model, "The robot")->capture_default_str();
  command.add_option("--pose-topic", flags.pose_topic,
                     "Default: /world/WORLD/dynamic_pose/info");
  command.add_option("--cmd-vel-topic", flags.command_topic, "Default: /model/MODEL/cmd_vel");
  command
      .add_option("--flavour", flags.flavour,
                  "Names of messages: ignition (Fortress), gz (Garden and later), both")
      ->check(CLI::IsMember({"ignition", "gz", "both"}))
      ->capture_default_str();
  command
      .add_option("--wait", flags.wait_s,
                  "Seconds for poses to come, and for the robot to be set down")
      ->check(CLI::Range(0.1, 3600.0))
      ->capture_default_str();
  command
      .add_option("--most-lag", flags.most_lag_s,
                  "Seconds by which Gazebo's clock may run ahead of what is worked on; then a "
                  "trial fails")
      ->check(CLI::Range(0.01, 60.0))
      ->capture_default_str();
}

}  // namespace

void add_gazebo_drive(CLI::App& gazebo) {
  auto flags = std::make_shared<DriveFlags>();
  CLI::App* command = gazebo.add_subcommand(
      "drive", "Search for objects in a running Gazebo: its physics, our camera and policy");
  command->add_option("bundle", flags->bundle, "Folder with scene.yaml")->required();
  command
      ->add_option("--goal", flags->goals, "Classes of the scene to search for, with commas")
      ->delimiter(',')
      ->required();
  command->add_option("--episodes", flags->episodes, "Searches, over all goals")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command
      ->add_option("--policy", flags->policy,
                   "Name of a policy with its usual settings (see `segsim run`)")
      ->capture_default_str();
  command
      ->add_option("--detector", flags->detector,
                   "oracle (the truth), or a file of weights or of a model")
      ->capture_default_str();
  command->add_option("--work", flags->work, "Folder of the run: rows, table, pictures")
      ->capture_default_str();
  command->add_flag("--new", flags->new_run, "Begin anew where another run is");
  add_gazebo_flags(*command, *flags);
  add_bundle_flags(*command, *flags);
  command->callback([flags] { drive(*flags); });
}

}  // namespace segsim::experiments::commands::bridges
