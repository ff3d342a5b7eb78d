#pragma once

// A recording in memory: surfels, seen with exact depth and labels.

#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "reconstruction/datasets/rgbd_sequence.h"
#include "renderer/cpu_renderer.h"
#include "tests/experiments/surfel_room.h"

namespace segsim::experiments {

class SurfelRecording : public reconstruction::RgbdSequence {
 public:
  /// @param surfels  With the classes of surfel_room.h.
  SurfelRecording(renderer::SurfelCloud surfels, std::vector<core::CameraPose> poses)
      : intrinsics_(core::CameraIntrinsics::from_fov(96, 72, std::numbers::pi / 2.0)),
        poses_(std::move(poses)) {
    const auto renderer = renderer::make_cpu_renderer(
        std::make_shared<const renderer::SurfelCloud>(std::move(surfels)));
    for (const core::CameraPose& pose : poses_) {
      const core::Frame drawn = renderer->render(pose, intrinsics_, core::Channels::kAll);
      reconstruction::RgbdFrame frame;
      frame.name = "view " + std::to_string(frames_.size());
      frame.rgb = drawn.rgb;
      frame.depth_m = drawn.depth_m;
      frame.T_world_camera = pose;
      frame.semantic = drawn.semantic;
      frame.instance = drawn.instance;
      frames_.push_back(std::move(frame));
    }
    classes_ = {{kShellClass, "wall", false}, {kBoxClass, "box", true}};
    instances_ = {{1, kBoxClass, "box 1", {}, {}}};
  }

  const std::string& name() const override { return name_; }
  const core::CameraIntrinsics& intrinsics() const override { return intrinsics_; }
  std::size_t frame_count() const override { return frames_.size(); }
  const std::string& frame_name(std::size_t i) const override { return frames_[i].name; }
  const core::CameraPose& pose(std::size_t i) const override { return poses_[i]; }
  reconstruction::RgbdFrame load(std::size_t i) const override { return frames_[i]; }
  bool has_masks() const override { return true; }
  const std::vector<core::SceneClass>& classes() const override { return classes_; }
  const std::vector<core::SceneInstance>& instances() const override { return instances_; }
  const std::vector<std::string>& warnings() const override { return nothing_; }
  const std::vector<std::string>& notes() const override { return nothing_; }

 private:
  std::string name_ = "room";
  core::CameraIntrinsics intrinsics_;
  std::vector<core::CameraPose> poses_;
  std::vector<reconstruction::RgbdFrame> frames_;
  std::vector<core::SceneClass> classes_;
  std::vector<core::SceneInstance> instances_;
  std::vector<std::string> nothing_;
};

}  // namespace segsim::experiments
