#pragma once

/// @file
/// Images as models got them in training: scaled like the library that was used there, then
/// normalised.

#include <array>
#include <vector>

#include "core/image.h"
#include "perception/models/internal/resample.h"
#include "perception/models/model_session.h"

namespace segsim::perception {

using ColourImage = core::Image<core::Rgb8>;

/// (value / 255 - mean) / deviation per channel.
struct Normalisation {
  std::array<float, 3> mean{0, 0, 0}, deviation{1, 1, 1};
};
inline constexpr Normalisation kZeroToOne{};
inline constexpr Normalisation kImageNet{{0.485F, 0.456F, 0.406F}, {0.229F, 0.224F, 0.225F}};
inline constexpr Normalisation kClipColours{{0.48145466F, 0.4578275F, 0.40821073F},
                                            {0.26862954F, 0.26130258F, 0.27577711F}};
inline constexpr Normalisation kHalfAndHalf{{0.5F, 0.5F, 0.5F}, {0.5F, 0.5F, 0.5F}};

/// As Pillow scales: the kernel (kLinear or kCubic, a = -0.5) covers an output pixel when
/// shrinking; columns after rows, each rounded to 8 bits.
[[nodiscard]] ColourImage resize_like_pillow(const ColourImage& image, int width_px,
                                             int height_px, Kernel kernel);
/// As OpenCV's INTER_LINEAR: four neighbours, whatever the scale.
[[nodiscard]] ColourImage resize_like_opencv(const ColourImage& image, int width_px,
                                             int height_px);
/// The middle of the image; the rest of a larger window is black.
[[nodiscard]] ColourImage centre_crop(const ColourImage& image, int side_px);

/// [1, 3, height, width], zero right of and below the image.
[[nodiscard]] HostTensor to_planes(const ColourImage& image, int width_px, int height_px,
                                   const Normalisation& normalisation);

/// The place of the one image input: [1, 3, h, w] or [b, 3, h, w].
/// @throws core::InputError with the signature if there is none or more than one.
[[nodiscard]] const TensorInfo& image_input(const ModelSession& session,
                                            const std::string& place);
/// The input with one of these names; nullptr if there is none.
[[nodiscard]] const TensorInfo* find_input(const ModelSession& session,
                                           std::initializer_list<const char*> names);
/// The same for outputs of a run.
[[nodiscard]] const HostTensor* find_output(const std::vector<ModelOutput>& outputs,
                                            std::initializer_list<const char*> names);
/// Side `axis` of an input if the file states it.
[[nodiscard]] int stated_side(const TensorInfo& info, std::size_t axis, int fallback);

}  // namespace segsim::perception
