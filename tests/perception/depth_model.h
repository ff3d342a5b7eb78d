#pragma once

/// @file
/// A small network with the signature of ZoeDepth: white is one metre away, what is darker
/// than middle grey is at 0 m.

#include <filesystem>

#include "tests/perception/model_files.h"
#include "tests/perception/onnx_builder.h"

namespace segsim::perception {

inline std::filesystem::path write_depth_model(const std::filesystem::path& folder) {
  GraphBuilder graph(17);
  graph.input("pixel_values", {1, 3, 8, 16});
  graph.node("ReduceMean", {"pixel_values"}, {"mean"}).with("axes", Ints{1});
  graph.node("Relu", {"mean"}, {"predicted_depth"});
  graph.output("predicted_depth");
  graph.save(folder / "depth.onnx");
  write_text(folder / "depth.yaml",
             "schema: segsim.model/1\ntask: depth\nfiles: {model: depth.onnx}\n"
             "colours: centred\n");
  return folder / "depth.yaml";
}

}  // namespace segsim::perception
