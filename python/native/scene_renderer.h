#pragma once

/// @file
/// What Python calls a renderer: one of ours that any thread may call.

#include <memory>
#include <mutex>
#include <string>

#include <nanobind/nanobind.h>

#include "core/camera.h"
#include "core/render.h"
#include "python/native/gpu_arrays.h"
#include "python/native/scene.h"

namespace segsim::python {

class SceneRenderer {
 public:
  /// @throws core::InputError for an option that is none or out of range, or a GPU that was
  ///     asked for and cannot do it.
  SceneRenderer(const Scene& scene, const std::string& backend, int threads, int top_k,
                const std::string& compat);

  /// Draws one view; calls of several threads wait for one another. Needs no Python.
  void draw(const core::CameraPose& T_world_camera, const core::CameraIntrinsics& intrinsics,
            core::Channels channels, core::Frame& frame);

  /// Draws views into the GPU's memory, in the order of the stream; likewise.
  /// @throws core::ContractViolation if the CPU draws.
  void draw_to(const Views& views, const GpuArrays& images, CUstream_st* stream);

  /// Draws views with the GPU into the memory of the processor; likewise.
  void draw_batch(const Views& views, core::Channels drawn,
                  std::span<const ImagePlace> places);

  [[nodiscard]] bool has_features() const { return has_features_; }
  [[nodiscard]] bool on_gpu() const { return on_gpu_; }
  [[nodiscard]] const char* backend() const { return on_gpu_ ? "cuda" : "cpu"; }
  /// Why `auto` took the CPU; empty if it did not.
  [[nodiscard]] const std::string& fallback_reason() const { return fallback_reason_; }
  /// Of the image that was drawn last.
  [[nodiscard]] core::RenderStats stats() const;

 private:
  bool has_features_;
  bool on_gpu_;
  std::string fallback_reason_;
  mutable std::mutex mutex_;  // Guards what follows.
  std::unique_ptr<core::Renderer> renderer_;
  core::RenderStats stats_;
};

/// Renderer.
void bind_renderer(nanobind::module_& module);

}  // namespace segsim::python
