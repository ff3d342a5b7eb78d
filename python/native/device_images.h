#pragma once

/// @file
/// Images of the GPU's renderer into arrays of Python that lie in the GPU's memory.

#include <cstddef>
#include <string>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "core/device_frames.h"
#include "core/render.h"
#include "python/native/camera_arguments.h"
#include "renderer/cuda/cuda_renderer.h"

namespace segsim::python {

class DeviceImages {
 public:
  /// @param images  A dict: name of a channel -> array [N, H, W(, C)] of a GPU that DLPack
  ///     exports, or [H, W(, C)] where there is a single pose.
  /// @throws core::InputError for what is none of that, or has another type or shape.
  DeviceImages(const nanobind::dict& images, const Views& views);

  [[nodiscard]] core::Channels drawn() const { return drawn_; }

  /// Draws all views and puts their copies into the stream; needs no Python.
  /// @throws core::InputError for arrays of another GPU than the renderer's.
  void draw(renderer::CudaRenderer& renderer, const Views& views, CUstream_st* stream) const;

 private:
  struct Image {
    std::string name;
    nanobind::ndarray<nanobind::device::cuda, nanobind::c_contig> array;
    std::size_t bytes_per_view;
    const void* (*source)(const core::DeviceFrames&);
  };

  std::vector<Image> images_;
  core::Channels drawn_ = core::Channels::kNone;
};

}  // namespace segsim::python
