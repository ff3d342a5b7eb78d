#pragma once

/// @file
/// The published sizes of YOLOv13 (Lei et al. 2025, "YOLOv13: real-time object detection with
/// hypergraph-enhanced adaptive visual perception").
///
///     channels of a layer      8 * ceil(min(c, max_channels) * width / 8)
///     repeats of a block, n>1  max(1, round(n * depth)), halves to the even number

#include <cstdint>
#include <string>
#include <string_view>

namespace segsim::perception::yolov13 {

enum class Scale { kN, kS, kL, kX };

inline constexpr Scale kAllScales[] = {Scale::kN, Scale::kS, Scale::kL, Scale::kX};

struct ScaleTable {
  char letter;
  double depth, width;
  int max_channels;
  int hyperedges;    ///< Of each of the two branches of HyperACE.
  bool deep_inner;   ///< l and x: DSC3k inside every DSC3k2, and a residual scale in A2C2f.
  double mlp_ratio;  ///< Hidden channels of an attention block's MLP over its own.
  std::int64_t parameters;  ///< Published, with 80 classes and the 16 constants of the DFL.
  int state_entries;        ///< Of the official state dict, counters of batches included.
  double published_gflops;  ///< At 640 px.

  [[nodiscard]] int channels(int nominal) const;
  [[nodiscard]] int repeats(int nominal) const;
};

[[nodiscard]] const ScaleTable& table_of(Scale scale);

/// "yolov13-n/1": how a weights file (weights_file.h) names the network.
[[nodiscard]] std::string architecture_of(Scale scale);
/// Whether the name is one of YOLOv13, of any scale.
[[nodiscard]] bool is_architecture(std::string_view architecture);
/// @throws core::InputError that starts with `place` if there is no such scale.
[[nodiscard]] Scale scale_of_architecture(std::string_view architecture,
                                          const std::string& place);

}  // namespace segsim::perception::yolov13
