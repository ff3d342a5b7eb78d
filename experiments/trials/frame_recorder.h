#pragma once

/// @file
/// Records what a trial's camera sees as a sequence of OpenEXR files (docs/exr.md).

#include <filesystem>

#include "core/render.h"
#include "core/scene_bundle.h"
#include "renderer/files/frame_writer.h"
#include "sim/trial/trial.h"

namespace segsim::experiments::trials {

/// One sequence. A recorded tick is rendered once more, with every channel, because the loop
/// itself does without normals; files are written on another thread. Neither changes what the
/// trial does, nor the times that are measured in it, but both use the machine.
class FrameRecorder {
 public:
  /// Removes the frames of an earlier trial from `folder`.
  /// @param every_ticks  Ticks 0, every_ticks, 2 * every_ticks ... are recorded, > 0.
  /// @param renderer  Of the scene; must outlive the recorder.
  FrameRecorder(std::filesystem::path folder, const core::SceneBundle& bundle, int every_ticks,
                core::Renderer& renderer);

  /// To be called once per tick. The file is called frame-<tick, six digits>.exr.
  /// @throws core::InputError if an earlier frame could not be written.
  void add(const sim::TickRecord& tick, const core::Frame& seen);

  /// Waits for the last frame. @throws core::InputError if one could not be written.
  void finish();

 private:
  std::filesystem::path folder_;
  renderer::FrameInfo info_;
  core::Renderer& renderer_;
  int every_ticks_;
  int tick_ = 0;
  core::Frame frame_;
  renderer::FrameWriter writer_;
};

}  // namespace segsim::experiments::trials
