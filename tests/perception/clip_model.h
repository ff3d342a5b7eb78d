#pragma once

/// @file
/// A small image-text model with the signature of CLIP or SigLIP.

#include <filesystem>
#include <string>

#include "tests/perception/model_files.h"
#include "tests/perception/onnx_builder.h"

namespace segsim::perception {

/// Image tower: mean colour after CLIP's normalisation. Text tower: a direction per id of the
/// second token, so that "chair" (5) looks red and "table" (7) blue.
inline std::filesystem::path write_clip(const std::filesystem::path& folder,
                                        const std::string& task) {
  GraphBuilder image(17);
  image.input("pixel_values", {1, 3, 8, 8});
  image.node("GlobalAveragePool", {"pixel_values"}, {"pooled"});
  image.node("Flatten", {"pooled"}, {"image_embeds"});
  image.output("image_embeds");
  image.save(folder / "image.onnx");
  GraphBuilder text(17);
  text.input("input_ids", {1, 6}, kInt64Type);
  text.input("attention_mask", {1, 6}, kInt64Type);
  Floats directions(27, 0.1F);
  directions[5 * 3] = 1;
  directions[7 * 3 + 2] = 1;
  text.floats("table", {9, 3}, directions);
  text.ints("second", {1});
  text.node("Gather", {"input_ids", "second"}, {"id"}).with("axis", 1);
  text.node("Gather", {"table", "id"}, {"row"});
  text.ints("flat", {1, 3});
  text.node("Reshape", {"row", "flat"}, {"text_embeds"});
  text.output("text_embeds");
  text.save(folder / "text.onnx");
  write_text(folder / "vocab.txt", kVocabulary);
  write_text(folder / "clip.yaml",
             "schema: segsim.model/1\ntask: " + task +
                 "\nfiles: {image: image.onnx, text: text.onnx, "
                 "tokenizer: vocab.txt}\n" +
                 (task == "siglip" ? "logit_scale: 2\nlogit_bias: -1\n" : ""));
  return folder / "clip.yaml";
}

}  // namespace segsim::perception
