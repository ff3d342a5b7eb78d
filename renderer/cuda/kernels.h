#pragma once

/// @file
/// The steps of a frame, in the order in which they are put into a stream. None of them waits.

#include "renderer/cuda/device_data.h"
#include "renderer/cuda/device_memory.h"

namespace segsim::renderer::cuda {

inline constexpr int kCamerasALaunch = 32;

/// @param width_px, height_px  Of the image.
[[nodiscard]] ViewCamera view_camera(const ProjectionCamera<float>& c, int width_px,
                                     int height_px);

/// Makes the present cameras the previous ones.
void launch_store_cameras(const ProjectionCamera<float>* cameras, int count,
                          const FrameView& frame, cudaStream_t stream);

/// Empties lists and counters; finds each tile's culling depth.
void launch_begin_frame(const FrameView& frame, cudaStream_t stream);

/// @param redo  Only what culling left out, for the tiles that need it.
void launch_project_and_bin(const FrameView& frame, const SceneView& scene, bool redo,
                            cudaStream_t stream);

void launch_order_tiles(const FrameView& frame, cudaStream_t stream);

/// Draws all tiles, or those that must be drawn again.
void launch_raster(const FrameView& frame, const SceneView& scene, const PanopticView& field,
                   const FeatureView& features, bool redo, cudaStream_t stream);

}  // namespace segsim::renderer::cuda
