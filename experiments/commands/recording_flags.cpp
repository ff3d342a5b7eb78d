#include "experiments/commands/recording_flags.h"

#include <CLI/CLI.hpp>

#include "experiments/commands/light/flag_values.h"

namespace segsim::experiments::commands {
namespace {

void add_world_options(CLI::App& command, RecordingFlags& flags) {
  command
      .add_option("--up", flags.up,
                  "auto | y | z: the recording's axis that points up; auto: the layout's, "
                  "unless the recording shows another direction")
      ->capture_default_str();
  command
      .add_option("--gravity", flags.gravity,
                  "Direction in which things fall, in the recording's frame; instead of --up")
      ->expected(3)
      ->check(light::coordinate())
      ->type_name("X Y Z");
  command
      .add_option("--floor-height", flags.floor_height_m,
                  "Floor along up, in the recording's frame [m]; default: found")
      ->check(light::coordinate())
      ->each([&flags](const std::string&) { flags.floor_given = true; });
}

/// What a recording holds other than its layout says.
void add_unit_options(CLI::App& command, RecordingFlags& flags) {
  const auto stated = [&flags](const std::string&) { flags.poses_stated = true; };
  command
      .add_option("--depth-scale", flags.depth_scale,
                  "What depth is multiplied with to become metres, after the layout's unit")
      ->check(CLI::Range(1e-6, 1e6))
      ->capture_default_str()
      ->each(stated);
  command
      .add_option("--pose-scale", flags.pose_scale,
                  "What positions of the poses are multiplied with to become metres; 0.001: "
                  "they are in millimetres")
      ->check(CLI::Range(1e-6, 1e6))
      ->capture_default_str()
      ->each(stated);
  command
      .add_flag("--invert-poses", flags.invert_poses,
                "The files hold world-to-camera where the layout says camera-to-world, or the "
                "other way round")
      ->each(stated);
}

void add_rig_options(CLI::App& command, RecordingFlags& flags) {
  command.add_option("--color-depth", flags.color_depth,
                     "Where the depth camera stands (YAML, docs/datasets.md), or estimate: "
                     "depth is reprojected into the colour camera; default: it is registered");
  command
      .add_option(
          "--depth-time-offset", flags.depth_time_offset,
          "What is added to stamps of depth images [ms], or estimate; depth is brought "
          "to the time of the colour image")
      ->type_name("MS|estimate");
  command
      .add_option("--pose-time-offset", flags.pose_time_offset,
                  "What is added to stamps of poses [ms], or estimate; poses are interpolated")
      ->type_name("MS|estimate");
  command
      .add_option("--frame-rate", flags.frame_rate_hz,
                  "Of a recording without time stamps: frames a second, by the numbers in "
                  "their names")
      ->check(CLI::Range(0.01, 1000.0))
      ->type_name("HZ");
  command
      .add_option(
          "--rolling-shutter", flags.read_out_ms,
          "How long the colour camera reads its rows, first to last, around an image's "
          "time [ms]; negative: from below. Pictures are straightened by the poses")
      ->check(CLI::Range(-specs::kLongestReadOut_ms, specs::kLongestReadOut_ms))
      ->type_name("MS");
  command
      .add_option("--sensor", flags.sensor,
                  "none | generic | kinect-v1 | tof | stereo | hololens: what measured depth; "
                  "depth then weighs by its error, and flying pixels of the time-of-flight "
                  "sensors (tof, hololens) are removed")
      ->capture_default_str();
}

}  // namespace

reconstruction::SequenceOptions RecordingFlags::options() const {
  reconstruction::SequenceOptions options;
  options.layout = reconstruction::parse_sequence_layout(layout, "--layout");
  options.up_axis = reconstruction::parse_up_axis(up, "--up");
  options.on_bad_frame = reconstruction::parse_on_bad_frame(on_bad_frame, "--on-bad-frame");
  options.label_map = label_map;
  options.depth_scale = depth_scale;
  options.pose_scale = pose_scale;
  options.invert_poses = invert_poses;
  if (!gravity.empty()) options.gravity = glm::dvec3(gravity[0], gravity[1], gravity[2]);
  if (floor_given) options.floor_height_m = floor_height_m;
  return options;
}

specs::RigSpec RecordingFlags::rig() const {
  specs::RigSpec rig;
  rig.estimate_color_depth = color_depth == "estimate";
  if (!rig.estimate_color_depth) rig.color_depth = color_depth;
  if (!depth_time_offset.empty()) {
    rig.depth_time = specs::parse_offset(depth_time_offset, "--depth-time-offset");
  }
  if (!pose_time_offset.empty()) {
    rig.pose_time = specs::parse_offset(pose_time_offset, "--pose-time-offset");
  }
  if (frame_rate_hz > 0.0) rig.frame_rate_hz = frame_rate_hz;
  rig.read_out_ms = read_out_ms;
  rig.sensor = reconstruction::parse_depth_sensor(sensor, "--sensor");
  return rig;
}

void add_recording_options(CLI::App& command, RecordingFlags& flags) {
  command.add_option("--label-map", flags.label_map,
                     "Classes of a data set's label images (YAML, docs/datasets.md)");
  command
      .add_option(
          "--layout", flags.layout,
          "auto | hololens | 7scenes | scannet | scannetpp | replica | tum | nerfstudio | "
          "colmap; `segsim reconstruct` also mcap and rosbag2 (docs/ros2.md)")
      ->capture_default_str();
  command
      .add_option("--on-bad-frame", flags.on_bad_frame,
                  "refuse | skip: what a broken image or pose does")
      ->capture_default_str();
  add_world_options(command, flags);
  add_unit_options(command, flags);
  add_rig_options(command, flags);
}

}  // namespace segsim::experiments::commands
