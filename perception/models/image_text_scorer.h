#pragma once

/// @file
/// How well an image fits a text:
///
///     clip     cosine of both embeddings; shortest side scaled to the input (bicubic), middle
///              cut out, CLIP's colours; text padded to 77 tokens
///     siglip   sigmoid(scale * cosine + bias) if the description has both, else the cosine;
///              scaled to the square, colours to [-1, 1]; text padded to 64 tokens
///     itm      image and text in one graph (BLIP-2's head): two logits per pair ->
///     probability
///              of the second, one number per pair -> that number
///
/// Graphs: two towers (`image`, `text`), or one with both inputs (`model`) and the outputs
/// image_embeds and text_embeds.

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "core/image.h"

namespace segsim::perception {

class ImageTextScorer {
 public:
  ImageTextScorer() = default;
  virtual ~ImageTextScorer() = default;
  ImageTextScorer(const ImageTextScorer&) = delete;
  ImageTextScorer& operator=(const ImageTextScorer&) = delete;

  /// One score per text. Embeddings of texts are kept for later calls.
  [[nodiscard]] virtual std::vector<float> scores(const core::Image<core::Rgb8>& image,
                                                  const std::vector<std::string>& texts) = 0;
};

/// @param model  A description with task clip, siglip or itm (model_description.h).
/// @throws core::InputError for damaged files, another signature or task.
[[nodiscard]] std::unique_ptr<ImageTextScorer> load_image_text_scorer(
    const std::filesystem::path& model);

}  // namespace segsim::perception
