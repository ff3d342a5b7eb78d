#include "python/native/gpu_arrays.h"

#include <algorithm>
#include <cstdint>
#include <span>

#include "core/error.h"

namespace segsim::python {
namespace {

namespace nb = nanobind;
using core::Channels;
using core::DeviceFrames;

/// What of a batch has a name in Python.
struct DeviceChannel {
  const char* name;
  Channels channel;
  const char* type;
  nb::dlpack::dtype dtype;
  std::size_t values;  ///< Of a pixel.
  const void* (*source)(const DeviceFrames&);
};

const DeviceChannel* channel_of(const std::string& name) {
  static const DeviceChannel channels[] = {
      {"rgb", Channels::kRgb, "uint8", nb::dtype<std::uint8_t>(), 3,
       [](const DeviceFrames& f) -> const void* { return f.rgb; }},
      {"depth", Channels::kDepth, "float32", nb::dtype<float>(), 1,
       [](const DeviceFrames& f) -> const void* { return f.depth_m; }},
      {"normal", Channels::kNormal, "float32", nb::dtype<float>(), 3,
       [](const DeviceFrames& f) -> const void* { return f.normal; }},
      // In a frame of labels alone pixels are finished before their alpha is known.
      {"alpha", Channels::kDepth, "float32", nb::dtype<float>(), 1,
       [](const DeviceFrames& f) -> const void* { return f.alpha; }},
      {"semantic", Channels::kLabels, "uint16", nb::dtype<std::uint16_t>(), 1,
       [](const DeviceFrames& f) -> const void* { return f.semantic; }},
      {"instance", Channels::kLabels, "uint16", nb::dtype<std::uint16_t>(), 1,
       [](const DeviceFrames& f) -> const void* { return f.instance; }},
      {"confidence", Channels::kLabels, "float32", nb::dtype<float>(), 1,
       [](const DeviceFrames& f) -> const void* { return f.confidence; }},
      {"instance_confidence", Channels::kLabels, "float32", nb::dtype<float>(), 1,
       [](const DeviceFrames& f) -> const void* { return f.instance_confidence; }},
      {"semantic_feature", Channels::kFeatures, "float32", nb::dtype<float>(), 16,
       [](const DeviceFrames& f) -> const void* { return f.semantic_feature; }},
      {"instance_feature", Channels::kFeatures, "float32", nb::dtype<float>(), 32,
       [](const DeviceFrames& f) -> const void* { return f.instance_feature; }}};
  const auto* end = std::end(channels);
  const auto* found = std::find_if(std::begin(channels), end,
                                   [&](const DeviceChannel& c) { return c.name == name; });
  if (found != end) return found;
  std::string all;
  for (const DeviceChannel& c : channels)
    all += (all.empty() ? "" : " | ") + std::string(c.name);
  throw core::InputError::expected("images", all, "\"" + name + "\"");
}

}  // namespace

GpuArrays::GpuArrays(const nb::dict& images, const Views& views) {
  const core::CameraIntrinsics& camera = views.intrinsics[0];
  const auto width = static_cast<std::size_t>(camera.width_px);
  const auto height = static_cast<std::size_t>(camera.height_px);
  for (const auto& [key, value] : images) {
    const std::string name = nb::str(key).c_str();
    const DeviceChannel& channel = *channel_of(name);
    const std::string place = "images[\"" + name + "\"]";
    Image image{name, {}, width * height * channel.values * (channel.dtype.bits / 8U)};
    if (!nb::try_cast(value, image.array, false)) {
      throw core::InputError::expected(place, "an array of a GPU, in rows without gaps",
                                       nb::repr(value.type()).c_str());
    }
    std::vector<std::size_t> shape{height, width}, found;
    if (views.batch) shape.insert(shape.begin(), views.T_world_camera.size());
    if (channel.values > 1) shape.push_back(channel.values);
    for (std::size_t axis = 0; axis < image.array.ndim(); ++axis) {
      found.push_back(image.array.shape(axis));
    }
    if (image.array.dtype() != channel.dtype || found != shape) {
      throw core::InputError::expected(
          place, std::string(channel.type) + " " + shape_text(shape),
          (image.array.dtype() == channel.dtype ? "" : "another type and ") +
              shape_text(found));
    }
    drawn_ = drawn_ | channel.channel;
    images_.push_back(std::move(image));
  }
  if (images_.empty()) {
    throw core::InputError::expected("images", "at least one array", "none");
  }
}

void draw_into(renderer::CudaRenderer& renderer, const Views& views, Channels drawn,
               std::span<const ImagePlace> places, CUstream_st* stream) {
  constexpr std::size_t kMostViews = 256;  // CudaRenderer::render_batch().
  const std::size_t count = views.T_world_camera.size();
  // Views of one call of the renderer have one camera.
  const std::size_t most = views.intrinsics.size() == 1 ? kMostViews : 1;
  std::vector<renderer::DeviceCopy> copies;
  for (std::size_t first = 0; first < count; first += most) {
    const std::size_t views_drawn = std::min(most, count - first);
    const DeviceFrames& frames =
        renderer.render_batch(std::span(views.T_world_camera).subspan(first, views_drawn),
                              views.intrinsics_of(first), drawn);
    copies.clear();
    for (const ImagePlace& place : places) {
      if (place.device != ImagePlace::kProcessor && place.device != frames.device) {
        throw core::InputError::expected("images[\"" + place.name + "\"]",
                                         "an array of GPU " + std::to_string(frames.device),
                                         "one of GPU " + std::to_string(place.device));
      }
      copies.push_back({channel_of(place.name)->source(frames),
                        place.to + first * place.bytes_per_view,
                        views_drawn * place.bytes_per_view});
    }
    renderer.copy_images(copies, stream);
  }
}

void GpuArrays::draw(renderer::CudaRenderer& renderer, const Views& views,
                     CUstream_st* stream) const {
  std::vector<ImagePlace> places;
  for (const Image& image : images_) {
    places.push_back({image.name,
                      static_cast<std::byte*>(const_cast<void*>(image.array.data())),
                      image.bytes_per_view, image.array.device_id()});
  }
  draw_into(renderer, views, drawn_, places, stream);
}

}  // namespace segsim::python
