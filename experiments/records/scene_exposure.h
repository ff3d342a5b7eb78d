#pragma once

/// @file
/// What an arm's detector has seen of the scenes that it is evaluated in, by the record in its
/// file (perception/checkpoint/lineage.h). A file without a record may have seen anything.

#include <cstdint>
#include <string>
#include <vector>

namespace segsim::experiments::records {

/// How much of the data that a detector was trained on is known.
enum class TrainingDataKnown : std::uint8_t { kAll, kPart, kNothing };

/// Lists are names of scenes of the spec, in its order.
struct SceneExposure {
  std::vector<std::string> trained_on{};  ///< Views of these were trained on or mixed in.
  /// The score threshold or the step was chosen on views of these.
  std::vector<std::string> threshold_on{};
  /// It learnt from another scene of that name: perhaps another reconstruction of the place.
  std::vector<std::string> same_name{};
  TrainingDataKnown known = TrainingDataKnown::kAll;

  bool operator==(const SceneExposure&) const = default;
  [[nodiscard]] bool is_trained_on(const std::string& scene) const;
};

/// "none", or parts with "; " between: "unknown" or "partly unknown", "trained on a, b",
/// "threshold chosen on a", "another scene named b".
[[nodiscard]] std::string exposure_text(const SceneExposure& exposure);
/// The inverse; what it does not understand makes it unknown.
[[nodiscard]] SceneExposure parse_exposure(const std::string& text);

}  // namespace segsim::experiments::records
