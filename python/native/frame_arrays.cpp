#include "python/native/frame_arrays.h"

#include <array>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <utility>

#include <glm/vec3.hpp>

#include "core/check.h"
#include "core/error.h"
#include "python/native/owned_array.h"

namespace segsim::python {
namespace {

namespace nb = nanobind;
using core::Channels;

/// What a pixel consists of.
template <class Pixel>
struct PixelLayout {
  using Scalar = Pixel;
};
template <>
struct PixelLayout<core::Rgb8> {
  using Scalar = std::uint8_t;
};
template <>
struct PixelLayout<glm::vec3> {
  using Scalar = float;
};
template <std::size_t n>
struct PixelLayout<std::array<float, n>> {
  using Scalar = float;
};
template <class Pixel>
using ScalarOf = typename PixelLayout<Pixel>::Scalar;
template <class Pixel>
constexpr std::size_t kScalars = sizeof(Pixel) / sizeof(ScalarOf<Pixel>);
static_assert(kScalars<core::Rgb8> == 3 && kScalars<glm::vec3> == 3);

/// Calls f(name, channel that draws it, image) for every image of a frame.
template <class AnyFrame, class F>
void visit_images(AnyFrame& frame, F&& f) {
  f("rgb", Channels::kRgb, frame.rgb);
  f("depth", Channels::kDepth, frame.depth_m);
  f("normal", Channels::kNormal, frame.normal);
  f("alpha", Channels::kNone, frame.alpha);
  f("semantic", Channels::kLabels, frame.semantic);
  f("instance", Channels::kLabels, frame.instance);
  f("confidence", Channels::kLabels, frame.confidence);
  f("instance_confidence", Channels::kLabels, frame.instance_confidence);
  f("depth_normal", Channels::kDepthNormal, frame.depth_normal);
  f("semantic_feature", Channels::kFeatures, frame.semantic_feature);
  f("instance_feature", Channels::kFeatures, frame.instance_feature);
}

/// Calls f(image) for the image of that name.
template <class AnyFrame, class F>
void visit_image(AnyFrame& frame, const std::string& wanted, F&& f) {
  visit_images(frame, [&](const char* name, Channels /*channel*/, auto& image) {
    if (name == wanted) f(image);
  });
}

template <class Pixel>
std::vector<std::size_t> image_shape(const core::Image<Pixel>& /*kind*/, int width_px,
                                     int height_px) {
  std::vector<std::size_t> shape{static_cast<std::size_t>(height_px),
                                 static_cast<std::size_t>(width_px)};
  if (kScalars < Pixel >> 1) shape.push_back(kScalars<Pixel>);
  return shape;
}

}  // namespace

ChannelChoice::ChannelChoice(std::vector<std::string> names) : names_(std::move(names)) {
  core::Frame frame;
  std::string all;
  visit_images(frame, [&](const char* name, Channels, auto&) {
    all += (all.empty() ? "" : " | ") + std::string(name);
  });
  bool alpha = false;
  for (const std::string& wanted : names_) {
    bool found = false;
    visit_images(frame, [&](const char* name, Channels channel, auto&) {
      if (name != wanted) return;
      drawn_ = drawn_ | channel;
      found = true;
    });
    if (!found) throw core::InputError::expected("channels", all, "\"" + wanted + "\"");
    alpha = alpha || wanted == "alpha";
  }
  // In a frame of labels alone pixels are finished before their alpha is known.
  if (alpha && drawn_ == Channels::kLabels) drawn_ = drawn_ | Channels::kDepth;
}

std::string missing_image(const core::Frame& frame, const ChannelChoice& choice) {
  for (const std::string& name : choice.names()) {
    bool empty = false;
    visit_image(frame, name, [&](const auto& image) { empty = image.pixels().empty(); });
    if (empty) return name;
  }
  return {};
}

nb::dict take_images(core::Frame&& frame, const ChannelChoice& choice) {
  nb::dict images;
  const int width_px = frame.intrinsics.width_px, height_px = frame.intrinsics.height_px;
  for (const std::string& name : choice.names()) {
    if (images.contains(name.c_str())) continue;
    visit_image(frame, name, [&]<class Pixel>(core::Image<Pixel>& image) {
      SEGSIM_CHECK(image.width_px() == width_px && image.height_px() == height_px, name);
      const auto shape = image_shape(image, width_px, height_px);
      images[name.c_str()] =
          owned_array<ScalarOf<Pixel>, Pixel>(std::move(image.pixels()), shape);
    });
  }
  return images;
}

FrameBatch::FrameBatch(const ChannelChoice& choice, std::size_t count, int width_px,
                       int height_px)
    : count_(count), width_px_(width_px), height_px_(height_px) {
  core::Frame frame;
  for (const std::string& name : choice.names()) {
    visit_image(frame, name, [&]<class Pixel>(core::Image<Pixel>&) {
      const std::size_t bytes = static_cast<std::size_t>(width_px) *
                                static_cast<std::size_t>(height_px) * sizeof(Pixel);
      channels_.push_back(
          {name, std::make_unique_for_overwrite<std::byte[]>(bytes * count), bytes});
    });
  }
}

void FrameBatch::put(std::size_t index, const core::Frame& frame) {
  for (const Channel& channel : channels_) {
    visit_image(frame, channel.name, [&](const auto& image) {
      SEGSIM_CHECK(image.width_px() == width_px_ && image.height_px() == height_px_,
                   channel.name);
      std::memcpy(channel.images.get() + index * channel.bytes_per_image, image.data(),
                  channel.bytes_per_image);
    });
  }
}

std::vector<ImagePlace> FrameBatch::places() const {
  std::vector<ImagePlace> places;
  for (const Channel& channel : channels_) {
    places.push_back({channel.name, channel.images.get(), channel.bytes_per_image});
  }
  return places;
}

nb::dict FrameBatch::take() {
  nb::dict arrays;
  core::Frame frame;
  for (Channel& channel : channels_) {
    visit_image(frame, channel.name, [&]<class Pixel>(core::Image<Pixel>& image) {
      auto shape = image_shape(image, width_px_, height_px_);
      shape.insert(shape.begin(), count_);
      auto memory = std::make_unique<std::unique_ptr<std::byte[]>>(std::move(channel.images));
      auto* data = reinterpret_cast<ScalarOf<Pixel>*>(memory->get());
      arrays[channel.name.c_str()] = array_over(data, std::move(memory), shape);
    });
  }
  return arrays;
}

}  // namespace segsim::python
