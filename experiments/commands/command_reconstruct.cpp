#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/process/temporary_folder.h"
#include "experiments/bags/unpack_recording.h"
#include "experiments/commands/commands.h"
#include "experiments/commands/light/flag_values.h"
#include "experiments/commands/recording_flags.h"
#include "experiments/scenes/placement_picture.h"
#include "experiments/scenes/reconstruct.h"
#include "experiments/scenes/recording_check.h"
#include "experiments/scenes/recording_rig.h"
#include "experiments/scenes/scene_source.h"
#include "experiments/scenes/stereo_recording.h"
#include "experiments/support/record_file.h"
#include "experiments/support/stop_signal.h"
#include "perception/data/image_file.h"
#include "reconstruction/labels/panoptic_head.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;

struct Flags {
  bags::UnpackOptions unpack;  ///< Of a recording of ROS 2.
  fs::path sequence, boxes, out, config, start, export_pack, check_picture;
  fs::path stereo_work, record;
  RecordingFlags recording;
  std::string robot = "jackal-gentle";
  std::string backend = "cpu", mesh = "auto", depth = "auto", labels = "frozen";
  std::vector<double> depth_range_m;  ///< Two numbers, or none.
  reconstruction::StereoOptions stereo;
  bool init_only = false, check = false;
  std::int64_t iterations = -1, label_iterations = -1;
  scenes::ReconstructOptions reconstruct;
  training::TrainingOptions training;
};

/// The file's settings with those given as flags.
reconstruction::TrainingConfig config_of(const Flags& flags) {
  reconstruction::TrainingConfig config;
  if (!flags.config.empty()) config = reconstruction::read_training_config(flags.config);
  if (flags.iterations >= 0) config.geometry.iterations = flags.iterations;
  if (flags.label_iterations >= 0) config.panoptic.iterations = flags.label_iterations;
  return config;
}

/// So many points find the floor.
std::vector<glm::vec3> thinned(const std::vector<glm::vec3>& points_m) {
  constexpr std::size_t kMost = 100'000;
  const std::size_t step = points_m.size() / kMost + 1;
  std::vector<glm::vec3> few;
  for (std::size_t i = 0; i < points_m.size(); i += step) few.push_back(points_m[i]);
  return few;
}

void check_head(const std::string& head) {
  std::vector<std::string> known = reconstruction::panoptic_head_names();
  known.emplace_back("none");
  if (std::find(known.begin(), known.end(), head) != known.end()) return;
  throw core::InputError::expected(
      "--head", reconstruction::panoptic_head_list(" | ") + " | none", "\"" + head + "\"");
}

bool trains_jointly(const std::string& labels) {
  if (labels == "frozen" || labels == "joint") return labels == "joint";
  throw core::InputError::expected("--labels", "frozen | joint", "\"" + labels + "\"");
}

/// What cannot be asked for together.
void check_outputs(const Flags& flags) {
  if (!flags.check_picture.empty() && !flags.check) {
    throw core::InputError::expected("--check-picture", "--check, too", "it alone");
  }
  if (flags.check) {
    if (flags.out.empty() && flags.export_pack.empty()) return;
    throw core::InputError::expected(
        "--check", "no --out or --export-pack: nothing is reconstructed", "one of them");
  }
  if (flags.out.empty() == flags.export_pack.empty()) {
    throw core::InputError::expected("segsim reconstruct", "--out or --export-pack",
                                     flags.out.empty() ? "neither" : "both");
  }
  if (!flags.init_only) return;
  if (!flags.export_pack.empty() || !flags.reconstruct.surfels.empty() ||
      !flags.reconstruct.pictures.empty()) {
    throw core::InputError::expected(
        "--init-only", "no --export-pack, --surfels or --pictures", "one of them");
  }
}

/// Beside the bundle, and before the long work: it tells whether that is worth while.
void write_placement_picture(const reconstruction::RgbdSequence& sequence,
                             const fs::path& out) {
  if (sequence.placement() == nullptr) return;
  std::vector<glm::dvec3> cameras_m;
  for (std::size_t i = 0; i < sequence.frame_count(); ++i) {
    cameras_m.push_back(sequence.pose(i).translation_m());
  }
  const auto picture = scenes::placement_picture(*sequence.placement(), cameras_m);
  if (picture.empty()) return;
  const fs::path file = out.string() + ".upright.png";
  perception::write_image(file, picture);
  std::printf("%s: up, floor and cameras from the side\n", file.string().c_str());
}

/// A recording of ROS 2 becomes a folder of another layout first.
void unpack_if_bag(Flags& flags, const fs::path& folder) {
  std::string& layout = flags.recording.layout;
  const fs::path ending = flags.sequence.extension();
  const bool by_name = layout == "auto" && (ending == ".mcap" || ending == ".db3");
  if (layout != "mcap" && layout != "rosbag2" && !by_name) return;
  const bags::UnpackSummary summary =
      bags::unpack_recording(flags.sequence, folder, flags.unpack);
  std::printf("%s: %zu colour and %zu depth images, poses of %s in %s\n", folder.c_str(),
              summary.color_images, summary.depth_images, summary.camera_frame.c_str(),
              summary.fixed_frame.c_str());
  if (summary.without_pose > 0) {
    std::fprintf(stderr, "warning: %zu colour images have no pose and are left out\n",
                 summary.without_pose);
  }
  if (!summary.truncation.empty()) {
    std::fprintf(stderr, "warning: %s\n", summary.truncation.c_str());
  }
  flags.sequence = folder;
  layout = "tum";
}

/// Broken frames are findings, not the end; a recording that cannot be read at all is.
void check(Flags flags) {
  const bool ends_with_slash = !flags.sequence.has_filename();
  const fs::path given = ends_with_slash ? flags.sequence.parent_path() : flags.sequence;
  const core::TemporaryFolder unpacked("segsim_recording");
  unpack_if_bag(flags, unpacked.path() / given.stem());
  reconstruction::SequenceOptions options = flags.recording.options();
  options.on_bad_frame = reconstruction::OnBadFrame::kSkip;
  options = scenes::with_rig(flags.sequence, options, flags.recording.rig());
  const auto sequence = scenes::open_recording(flags.sequence, flags.boxes, options);
  for (const std::string& note : sequence->notes()) std::printf("%s\n", note.c_str());
  scenes::check_recording(*sequence, flags.check_picture.empty()
                                         ? fs::path(sequence->name() + ".check.png")
                                         : flags.check_picture);
}

/// A recording that is ready to be lifted.
struct Opened {
  std::unique_ptr<reconstruction::RgbdSequence> sequence;
  std::optional<scenes::StereoRecording> stereo;  ///< Its sequence has been moved away.
};

/// Opens the recording with the depth that was asked for.
Opened open_with_depth(const Flags& flags, reconstruction::SequenceOptions options) {
  using scenes::DepthSource;
  const DepthSource depth = scenes::parse_depth_source(flags.depth, "--depth");
  if (depth == DepthSource::kNone) options.ignore_depth = true;
  Opened opened{scenes::open_recording(flags.sequence, flags.boxes, options), {}};
  const bool start_given = flags.reconstruct.start.has_value();
  const bool stereo =
      depth == DepthSource::kStereo ||
      (depth == DepthSource::kAuto && !opened.sequence->has_depth() && !start_given);
  if (!stereo) return opened;
  if (flags.stereo.width_px > opened.sequence->intrinsics().width_px) {
    std::fprintf(stderr, "warning: --stereo-width: pictures are %d px wide\n",
                 opened.sequence->intrinsics().width_px);
  }
  reconstruction::StereoOptions options_of_stereo = flags.stereo;
  if (!flags.depth_range_m.empty()) {
    options_of_stereo.depth_range_m = {flags.depth_range_m[0], flags.depth_range_m[1]};
  }
  options_of_stereo.frame_step = flags.reconstruct.lift.frame_step;
  options_of_stereo.threads = flags.training.device.threads;
  if (!flags.init_only) {  // What tests the result is not looked at.
    options_of_stereo.held_out_every = flags.training.set.held_out_every;
  }
  const fs::path beside = flags.out.empty() ? flags.export_pack : flags.out;
  opened.stereo = scenes::open_with_stereo(
      flags.sequence, flags.boxes, options, *opened.sequence, options_of_stereo,
      flags.stereo_work.empty() ? fs::path(beside.string() + ".stereo") : flags.stereo_work);
  opened.sequence = std::move(opened.stereo->sequence);
  return opened;
}

/// Quality and time, for results/. Rows are named by the bundle.
void save_record(const Flags& flags, const Opened& opened, const core::SceneBundle& bundle,
                 double wall_s) {
  if (flags.record.empty()) return;
  const std::string row = flags.out.filename().string();
  core::MeasurementRecord record;
  record.title = "A reconstruction";
  const auto add = [&](const char* name, const char* unit, double value) {
    record.values.push_back({row, name, unit, value});
  };
  if (opened.stereo && opened.stereo->comparison) {
    const reconstruction::DepthComparison& depth = *opened.stereo->comparison;
    add("depth error, median", "%", 100.0 * depth.median_share);
    add("depth error, 90 %", "%", 100.0 * depth.high_share);
    add("median error", "cm", 100.0 * depth.median_m);
    add("90 % error", "cm", 100.0 * depth.high_m);
    add("within 5 %", "%", 100.0 * depth.within_5_percent);
    add("completeness", "%", 100.0 * depth.completeness());
  }
  if (opened.stereo) {
    add("frames matched", "", static_cast<double>(opened.stereo->report.frames_matched));
    add("time of stereo", "s", opened.stereo->report.seconds);
  }
  for (const auto& [name, value] : bundle.manifest.statistics) {
    if (name == "held_out_psnr_db") add("held-out PSNR", "dB", value);
    if (name == "held_out_ssim") add("held-out SSIM", "", value);
    if (name == "surfels") add("surfels", "", value);
  }
  add("time of all", "s", wall_s);
  support::save_record(flags.record, record);
}

void check_stereo_flags(const Flags& flags) {
  (void)scenes::parse_depth_source(flags.depth, "--depth");
  if (!flags.record.empty() && flags.out.empty()) {
    throw core::InputError::expected("--record", "--out, too", "it alone");
  }
  if (flags.depth_range_m.empty()) return;
  const double near_m = flags.depth_range_m[0], far_m = flags.depth_range_m[1];
  if (near_m > 0.0 && far_m >= 1.5 * near_m) return;
  char found[64];
  std::snprintf(found, sizeof found, "%g %g", near_m, far_m);
  throw core::InputError::expected(
      "--depth-range", "NEAR > 0 and FAR at least 1.5 times as far, in metres", found);
}

void reconstruct(Flags flags) {
  const auto begin = std::chrono::steady_clock::now();
  const support::StopOnSignal signals;
  check_outputs(flags);
  check_stereo_flags(flags);
  if (flags.check) {
    check(flags);
    return;
  }
  if (!flags.init_only) {
    check_head(flags.training.head);
    flags.training.config = config_of(flags);
    flags.training.device.backend = renderer::backend_of(flags.backend);
    flags.training.joint = trains_jointly(flags.labels);
    training::check_joint(flags.training);
    flags.training.set.frame_step = flags.reconstruct.lift.frame_step;
    flags.reconstruct.training = flags.training;
  }
  const fs::path beside = flags.out.empty() ? flags.export_pack : flags.out;
  flags.reconstruct.source = "recording " + flags.sequence.filename().string();
  unpack_if_bag(flags, beside.string() + ".recording");
  reconstruction::SequenceOptions options = flags.recording.options();
  flags.reconstruct.collision.floor_is_known = flags.recording.floor_given;
  if (!flags.start.empty()) {
    flags.reconstruct.start = reconstruction::read_point_cloud(flags.start);
    options.floor_points_m = thinned(flags.reconstruct.start->position_m);
  }
  options = scenes::with_rig(flags.sequence, options, flags.recording.rig(),
                             beside.string() + ".color_depth.yaml");
  const Opened opened = open_with_depth(flags, options);
  const auto& sequence = opened.sequence;
  for (const std::string& note : sequence->notes()) std::printf("%s\n", note.c_str());
  scenes::refuse_wrong_poses(*sequence, flags.recording.poses_stated);

  if (!flags.export_pack.empty()) {
    scenes::export_training_pack(*sequence, flags.reconstruct, flags.export_pack);
    std::printf("%s: %.1f MB\n", flags.export_pack.string().c_str(),
                1e-6 * static_cast<double>(fs::file_size(flags.export_pack)));
    return;
  }
  write_placement_picture(*sequence, flags.out);
  flags.reconstruct.mesh = scenes::parse_mesh_source(flags.mesh, "--mesh");
  worlds::DepthFusionOptions& fusion = flags.reconstruct.surface.fusion;
  fusion.truncation_m = scenes::kTruncationVoxels * fusion.voxel_m;
  flags.reconstruct.name = flags.out.filename().string();
  flags.reconstruct.credits = scenes::read_credits(flags.sequence);
  flags.reconstruct.robot = sim::RobotModel::by_name(flags.robot);
  const core::SceneBundle bundle =
      scenes::reconstruct_bundle(*sequence, flags.reconstruct, flags.out);
  std::printf("%s: %zu classes, %zu instances%s; see `segsim scene inspect`\n",
              flags.out.string().c_str(), bundle.manifest.classes.size(),
              bundle.manifest.instances.size(),
              bundle.manifest.navmesh.name.empty() ? ", for rendering and labels only" : "");
  save_record(flags, opened, bundle,
              std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
}

/// What a recording of ROS 2 calls things.
void add_bag_options(CLI::App& command, bags::UnpackOptions& options) {
  command
      .add_option("--color-topic", options.color_topic,
                  "Colour images of a recording of ROS 2")
      ->capture_default_str();
  command
      .add_option("--depth-topic", options.depth_topic, "Its depth images, of the same view")
      ->capture_default_str();
  command.add_option("--info-topic", options.info_topic, "Calibration of its camera")
      ->capture_default_str();
  command.add_option("--fixed-frame", options.fixed_frame,
                     "Frame of its transforms in which the scene stands still, z up (default: "
                     "map, else odom, else the root)");
}

/// Depth of recordings that have none.
void add_stereo_options(CLI::App& command, const std::shared_ptr<Flags>& flags) {
  command
      .add_option(
          "--depth", flags->depth,
          "auto | recorded | stereo | none: where depth comes from. stereo: found in the "
          "pictures, by their poses; auto: stereo for recordings without depth")
      ->capture_default_str();
  command
      .add_option(
          "--depth-range", flags->depth_range_m,
          "Of stereo: nearest and farthest surface along a view's axis [m]; default: by "
          "COLMAP's sparse points, else by where the cameras were")
      ->expected(2)
      ->type_name("NEAR FAR");
  command
      .add_option(
          "--stereo-width", flags->stereo.width_px,
          "Of stereo: width of the pictures that are matched [px]; twice the width takes "
          "about eight times as long")
      ->check(CLI::Range(64, 4096))
      ->capture_default_str();
  command
      .add_option("--stereo-sources", flags->stereo.sources,
                  "Of stereo: views that each view is matched with")
      ->check(CLI::Range(2, 16))
      ->capture_default_str();
  command.add_option("--stereo-work", flags->stereo_work,
                     "Of stereo: folder of the depth images, where a stopped run goes on; "
                     "default: OUT.stereo");
  command.add_option("--record", flags->record, support::kRecordHelp);
}

void add_training_options(CLI::App& command, const std::shared_ptr<Flags>& flags) {
  training::TrainingOptions& training = flags->training;
  command.add_flag("--init-only", flags->init_only, "Lift, do not train");
  command.add_option(
      "--config", flags->config,
      "Weights and rates (YAML); all keys are in reconstruction/training/defaults.yaml");
  command
      .add_option("--iterations", flags->iterations,
                  "Images that shape and colour are trained on; default: the "
                  "configuration's")
      ->check(CLI::Range(0, 10'000'000));
  command
      .add_option("--label-iterations", flags->label_iterations,
                  "Images that labels are trained on; default: the configuration's")
      ->check(CLI::Range(1, 10'000'000));
  command.add_option(
      "--masks", training.masks,
      "Folder of per-view masks (docs/masks.md); default: the recording's labels");
  command
      .add_option("--head", training.head,
                  reconstruction::panoptic_head_list(" | ") + " | none: what learns labels")
      ->capture_default_str();
  command
      .add_option(
          "--labels", flags->labels,
          "frozen: labels are learnt on finished surfels | joint: both learn together, "
          "on the CPU (docs/training.md)")
      ->capture_default_str();
  command
      .add_option("--held-out-every", training.set.held_out_every,
                  "Every n-th frame tests the result and is not trained on; 0: none")
      ->check(CLI::Range(0, 1'000'000))
      ->capture_default_str();
  command.add_flag("--align-held-out", training.align_held_out,
                   "Test also at held-out poses that fit the trained surfels best; both "
                   "figures are reported");
  command
      .add_option("--shrink", training.set.shrink,
                  "Train and test on images whose pixels are the means of n x n recorded ones")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  command.add_option("--surfels", flags->reconstruct.surfels,
                     "Train on from these surfels (PLY), for example train_pack's --out");
  command.add_option("--export-pack", flags->export_pack,
                     "Write frames and lifted surfels for train_pack, and stop");
  command.add_option("--pictures", flags->reconstruct.pictures,
                     "Contact sheet (.png) of views where a robot would be");
  command.add_option("--backend", flags->backend, "cpu | cuda | auto")->capture_default_str();
  command.add_option("--threads", training.device.threads, "Of the CPU; 0: all")
      ->check(CLI::Range(0, 4096))
      ->capture_default_str();
  command.add_option("--seed", training.seed, "Of all random choices")->capture_default_str();
  command
      .add_option("--time-limit", training.time_limit_s,
                  "Stop each stage early to end near this [s]; 0: none. Results then depend "
                  "on the machine")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command.add_flag("--resume", training.resume,
                   "Go on from the state in OUT.training, if there is one");
}

void add_check_options(CLI::App& command, const std::shared_ptr<Flags>& flags) {
  command.add_flag("--check", flags->check,
                   "Read the recording, print what will be hard (docs/datasets.md) and stop");
  command.add_option("--check-picture", flags->check_picture,
                     "Of --check: where cameras looked, from above (.png); default: "
                     "NAME.check.png in the working folder");
}

}  // namespace

void add_reconstruct_command(CLI::App& app) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = light::add_listed(app, light::kCommands, "reconstruct");
  command
      ->add_option("sequence", flags->sequence,
                   "Folder in one of the layouts of docs/datasets.md, or a recording of ROS 2 "
                   "(.mcap, .db3)")
      ->required();
  command->add_option("--out", flags->out, "Bundle folder");
  command->add_option("--boxes", flags->boxes,
                      "3-D boxes (JSON) that label a recording without masks");
  add_recording_options(*command, flags->recording);
  add_bag_options(*command, flags->unpack);
  command->add_option("--start", flags->start,
                      "Point cloud (PCD or PLY, in the coordinates of the recording's poses) "
                      "to start from instead of the frames' depth");
  reconstruction::LiftOptions& lift = flags->reconstruct.lift;
  command->add_option("--voxel", lift.voxel_m, "Spacing of the surfels [m]")
      ->check(CLI::Range(0.002, 0.5))
      ->capture_default_str();
  command->add_option("--frame-step", lift.frame_step, "Use every n-th frame")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command
      ->add_option("--mesh", flags->mesh,
                   "auto | lifted | depth: what the collision mesh is made from; auto: depth "
                   "rendered from a trained scene, else the lifted points")
      ->capture_default_str();
  command
      ->add_option("--mesh-voxel", flags->reconstruct.surface.fusion.voxel_m,
                   "Of the surface that rendered depth is fused to [m]")
      ->check(CLI::Range(0.005, 0.2))
      ->capture_default_str();
  command->add_option("--robot", flags->robot, "Whose free space is checked and meshed")
      ->capture_default_str();
  command
      ->add_option("--camera-height", flags->reconstruct.camera_height_m,
                   "Mast height that suits the recording [m]")
      ->check(light::camera_height_m())
      ->capture_default_str();
  core::GeodeticOrigin& origin = flags->reconstruct.origin;
  command->add_option("--latitude", origin.latitude_deg, "Of the world origin [degrees]")
      ->check(CLI::Range(-90.0, 90.0))
      ->capture_default_str();
  command->add_option("--longitude", origin.longitude_deg, "Of the world origin [degrees]")
      ->check(CLI::Range(-360.0, 360.0))
      ->capture_default_str();
  command->add_option("--origin-height", origin.height_m, "Of the world origin [m]")
      ->check(light::coordinate())
      ->capture_default_str();
  command->add_option("--origin-yaw", origin.yaw_rad, "From east to world +x [rad]")
      ->check(light::coordinate())
      ->capture_default_str();
  add_stereo_options(*command, flags);
  add_check_options(*command, flags);
  add_training_options(*command, flags);
  command->callback([flags] { reconstruct(*flags); });
}

}  // namespace segsim::experiments::commands
