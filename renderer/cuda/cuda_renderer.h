#pragma once

/// @file
/// The surfel rasterizer for NVIDIA GPUs of compute capability 8.0 and above: the picture of
/// cpu_renderer.h, from the same formulas (surfel_geometry.h).
///
///     surfels on screen, exact tile rows, one list a tile      (project.cu)
///       -> tiles, longest lists first
///       -> sort, blend front to back, Top-K, labels, images    (raster.cu: one kernel)
///       -> tiles that needed what the last frame hid, again
///
/// A frame is one CUDA graph without host synchronisation. With RenderOptions::skip_hidden,
/// and where that halves the lists, a tile's list leaves out what lies behind the depth at
/// which the tile's pixels were finished in the frame before (reprojected); a tile that is not
/// finished with its short list is drawn again with the whole one, so that the picture is the
/// same.
///
/// Equal inputs give equal pictures: lists are in order of (depth, index), and no result is
/// summed in an order that may change.
///
/// Not here: RenderOptions::compat other than kExact, and top_k == kAllSurfels.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "core/device_frames.h"
#include "core/render.h"
#include "renderer/cuda/gpu_error.h"
#include "renderer/scene/panoptic_field.h"
#include "renderer/scene/render_options.h"
#include "renderer/scene/surfels.h"

namespace segsim::renderer {

/// Duration of a frame's steps by device events [ms].
struct CudaStageTimes {
  double begin_ms = 0, project_ms = 0, order_ms = 0, raster_ms = 0, redo_ms = 0;
};

/// An image of a batch, or a part of it, and where in the memory of the device or the host it
/// shall be.
struct DeviceCopy {
  const void* from;  ///< Where a member of core::DeviceFrames points.
  void* to;
  std::size_t bytes;
};

/// One object serves one thread.
class CudaRenderer : public core::Renderer {
 public:
  using core::Renderer::render;

  /// Puts a batch of views of one size into the stream and returns at once. The images are
  /// complete after wait() and stay until the next call.
  /// @param T_world_camera  1 ... 256 poses. Camera i should be near camera i of the call
  ///     before: then hidden surfels are skipped well.
  /// @throws GpuError, core::ContractViolation
  virtual const core::DeviceFrames& render_batch(
      std::span<const core::CameraPose> T_world_camera,
      const core::CameraIntrinsics& intrinsics, core::Channels channels) = 0;

  /// Waits for the batch. If a list was longer than its buffer, buffers grow and the batch is
  /// drawn again: no frame is lost.
  virtual void wait() = 0;

  /// Copies image `index` of the last batch to the host through page-locked memory, only the
  /// channels asked for (among those rendered). Calls wait().
  virtual void read_back(int index, core::Channels channels, core::Frame& frame) = 0;

  /// Puts copies of the last batch's images into a stream of the caller, after what is there
  /// already; the next batch waits for them. Those to memory of the host that is not
  /// page-locked are complete on return. Calls wait().
  virtual void copy_images(std::span<const DeviceCopy> copies, CUstream_st* stream) = 0;

  /// Counters of the last batch; calls wait(). RenderStats::contributions and feature_fetches
  /// need count_contributions(true), which makes frames slower.
  virtual core::RenderStats stats() = 0;
  /// Tiles of the last batch that were drawn twice; calls wait().
  virtual std::uint32_t fixed_tiles() = 0;
  virtual void count_contributions(bool counts) = 0;

  /// RenderOptions::skip_hidden applies where it halves the lists, which the first two frames
  /// of a size show; with `always`, everywhere. The picture is the same.
  virtual void always_skip_hidden(bool always) = 0;

  /// Draws the last batch again step by step, with events between.
  virtual CudaStageTimes measure_stages() = 0;

  /// Fills the images with bytes of 0xA5, so that a test sees pixels that no one wrote.
  virtual void poison_images() = 0;
};

/// Copies the scene to the present device.
/// @param field  Labels come from here if it is given, else from the surfels' own ids.
/// @throws GpuError; core::ContractViolation for a scene or option out of range.
[[nodiscard]] std::unique_ptr<CudaRenderer> make_cuda_renderer(
    std::shared_ptr<const SurfelCloud> surfels, RenderOptions options = {},
    std::shared_ptr<const PanopticField> field = nullptr);

}  // namespace segsim::renderer
