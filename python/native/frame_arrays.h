#pragma once

/// @file
/// Images of a frame by name, as NumPy arrays.

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include <nanobind/nanobind.h>

#include "core/render.h"

namespace segsim::python {

/// The images that a call wants, by name, in its order.
class ChannelChoice {
 public:
  /// @throws core::InputError for a name that is no channel's.
  explicit ChannelChoice(std::vector<std::string> names);

  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  [[nodiscard]] core::Channels drawn() const { return drawn_; }

 private:
  std::vector<std::string> names_;
  core::Channels drawn_ = core::Channels::kNone;
};

/// The name of a chosen image that the frame lacks; empty if there is none.
[[nodiscard]] std::string missing_image(const core::Frame& frame, const ChannelChoice& choice);

/// The images of one frame, which gives up their memory: name -> [H, W] or [H, W, C].
[[nodiscard]] nanobind::dict take_images(core::Frame&& frame, const ChannelChoice& choice);

/// Where the images of one channel go, view after view.
struct ImagePlace {
  static constexpr int kProcessor = -1;
  std::string name;
  std::byte* to;
  std::size_t bytes_per_view;
  int device = kProcessor;  ///< Number of the GPU whose memory it is.
};

/// Images of several frames of one size, one behind the other: name -> [N, H, W(, C)].
class FrameBatch {
 public:
  /// @throws std::bad_alloc, in Python MemoryError.
  FrameBatch(const ChannelChoice& choice, std::size_t count, int width_px, int height_px);

  /// Copies the images of frame `index`; needs no Python.
  void put(std::size_t index, const core::Frame& frame);
  /// For who puts all frames at once.
  [[nodiscard]] std::vector<ImagePlace> places() const;
  [[nodiscard]] nanobind::dict take();

 private:
  struct Channel {
    std::string name;
    std::unique_ptr<std::byte[]> images;
    std::size_t bytes_per_image;
  };

  std::vector<Channel> channels_;
  std::size_t count_;
  int width_px_, height_px_;
};

}  // namespace segsim::python
