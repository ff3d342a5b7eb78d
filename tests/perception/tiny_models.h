#pragma once

/// @file
/// Small exported models with the signatures of the real ones.

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>

#include "model_files.h"
#include "onnx_builder.h"

namespace segsim::perception {

/// 4 x 4 cells of 16 px; a cell's score of class 0 is its mean red, of class 1 its mean blue;
/// its box is the cell, in the layout [1, 4 + classes, cells] of YOLO v8 to v13.
inline void add_cell_head(GraphBuilder& builder, const std::string& predictions) {
  builder.input("images", {1, 3, 64, 64});
  builder.node("AveragePool", {"images"}, {"means"})
      .with("kernel_shape", Ints{16, 16})
      .with("strides", Ints{16, 16});
  builder.ints("red_blue", {0, 2});
  builder.node("Gather", {"means", "red_blue"}, {"two"}).with("axis", 1);
  builder.ints("flat", {1, 2, 16});
  builder.node("Reshape", {"two", "flat"}, {"scores"});
  Floats cells(64);
  for (std::size_t i = 0; i < 16; ++i) {
    cells[i] = static_cast<float>(i % 4) * 16 + 8;
    cells[16 + i] = static_cast<float>(i / 4) * 16 + 8;
    cells[32 + i] = cells[48 + i] = 16;
  }
  builder.floats("cells", {1, 4, 16}, cells);
  builder.node("Concat", {"cells", "scores"}, {predictions}).with("axis", 1);
}

/// @param names  Of the classes 0 and 1, as Ultralytics writes them.
inline std::filesystem::path write_yolo(
    const std::filesystem::path& folder,
    const std::string& names = "{0: 'chair', 1: \"cat's bed\"}") {
  GraphBuilder builder(12);
  add_cell_head(builder, "output0");
  builder.output("output0");
  builder.metadata("names", names);
  builder.save(folder / "yolo.onnx");
  return folder / "yolo.onnx";
}

/// The segmenter: its decoder paints the box it was given.
/// Averages 16 x 16 px, and a description beside it.
inline void write_sam_encoder(const std::filesystem::path& folder) {
  GraphBuilder builder(17);
  builder.input("x", {1, 3, 64, 64});
  builder.node("AveragePool", {"x"}, {"image_embeddings"})
      .with("kernel_shape", Ints{16, 16})
      .with("strides", Ints{16, 16});
  builder.output("image_embeddings");
  builder.save(folder / "encoder.onnx");
  write_text(folder / "sam.yaml",
             "schema: segsim.model/1\ntask: sam\n"
             "files: {encoder: encoder.onnx, decoder: decoder.onnx}\n");
}

/// min(x - x0, x1 - x, y - y0, y1 - y) at the centres of a 16 x 16 grid over the square.
/// @param corners  The input that has them: "point_coords", or "input_boxes" as Hugging Face
///                 calls it.
inline void write_sam_decoder(const std::filesystem::path& folder,
                              const std::string& corners = "point_coords") {
  GraphBuilder builder(17);
  builder.input("image_embeddings", {1, 3, 4, 4});
  const bool boxes = corners == "input_boxes";
  if (boxes) {
    builder.input("input_boxes", {1, 1, 4});
    builder.input("input_points", {1, 1, -1, 2});
    builder.input("input_labels", {1, 1, -1}, kInt64Type);
  } else {
    builder.input("point_coords", {1, -1, 2});
    builder.input("point_labels", {1, -1});
    builder.input("mask_input", {1, 1, 256, 256});
    builder.input("has_mask_input", {1});
  }
  Floats xs(256), ys(256);
  for (std::size_t i = 0; i < 256; ++i) {
    xs[i] = (static_cast<float>(i % 16) + 0.5F) * 4;
    ys[i] = (static_cast<float>(i / 16) + 0.5F) * 4;
  }
  builder.floats("xs", {1, 1, 16, 16}, xs);
  builder.floats("ys", {1, 1, 16, 16}, ys);
  builder.ints("four", {4});
  builder.node("Reshape", {corners, "four"}, {"corners"});
  builder.node("Split", {"corners"}, {"x0", "y0", "x1", "y1"}).with("axis", 0);
  builder.node("Sub", {"xs", "x0"}, {"left"});
  builder.node("Sub", {"x1", "xs"}, {"right"});
  builder.node("Sub", {"ys", "y0"}, {"above"});
  builder.node("Sub", {"y1", "ys"}, {"below"});
  builder.node("Min", {"left", "right", "above", "below"}, {"one_mask"});
  builder.node("Neg", {"one_mask"}, {"outside"});
  builder.node("Concat", {"outside", "one_mask"}, {"low_res_masks"}).with("axis", 1);
  if (boxes) {
    builder.node("Cast", {"input_labels"}, {"labels"}).with("to", kFloatType);
  } else {
    builder.node("Identity", {"point_labels"}, {"labels"});
  }
  builder.node("ReduceMean", {"labels"}, {"label"}).with("keepdims", 0);  // 2.5, or -10.
  builder.floats("factors", {1, 2}, boxes ? Floats{-0.01F, -0.09F} : Floats{0.1F, 0.36F});
  builder.node("Mul", {"factors", "label"}, {"iou_predictions"});
  builder.output("iou_predictions");
  builder.output("low_res_masks");
  builder.save(folder / "decoder.onnx");
}

}  // namespace segsim::perception
