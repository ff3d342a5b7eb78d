#pragma once

/// @file
/// Batches of the GPU's renderer into arrays of Python, in the GPU's memory or in that of the
/// processor.

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "core/device_frames.h"
#include "core/render.h"
#include "python/native/camera_arguments.h"
#include "python/native/frame_arrays.h"
#include "renderer/cuda/cuda_renderer.h"

namespace segsim::python {

/// Draws all views in as few calls as possible and puts the copies of their images into the
/// stream; those to the processor are complete on return. Needs no Python.
/// @param drawn  What `places` need; without depth normals, which no GPU draws.
/// @throws core::InputError for memory of another GPU than the renderer's.
void draw_into(renderer::CudaRenderer& renderer, const Views& views, core::Channels drawn,
               std::span<const ImagePlace> places, CUstream_st* stream);

class GpuArrays {
 public:
  /// @param images  A dict: name of a channel -> array [N, H, W(, C)] of a GPU that DLPack
  ///     exports, or [H, W(, C)] where there is a single pose.
  /// @throws core::InputError for what is none of that, or has another type or shape.
  GpuArrays(const nanobind::dict& images, const Views& views);

  [[nodiscard]] core::Channels drawn() const { return drawn_; }

  /// Draws all views and puts their copies into the stream; needs no Python.
  /// @throws core::InputError for arrays of another GPU than the renderer's.
  void draw(renderer::CudaRenderer& renderer, const Views& views, CUstream_st* stream) const;

 private:
  struct Image {
    std::string name;
    nanobind::ndarray<nanobind::device::cuda, nanobind::c_contig> array;
    std::size_t bytes_per_view;
  };

  std::vector<Image> images_;
  core::Channels drawn_ = core::Channels::kNone;
};

}  // namespace segsim::python
