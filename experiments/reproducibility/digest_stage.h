#pragma once

/// @file
/// The stages of an experiment whose results have digests, in their order.

#include <cstdint>
#include <string>
#include <string_view>

namespace segsim::experiments::reproducibility {

enum class DigestStage : std::uint8_t {
  kCapture,         ///< The frames of a mesh world.
  kReconstruction,  ///< A bundle.
  kPhrases,         ///< What those of one scene mean.
  kEpisodes,        ///< Of one scene.
  kLabels,          ///< A set of views.
  kWeights,         ///< Of one arm.
  kTrials,          ///< All of them.
};

/// The name in records: "capture", ...
[[nodiscard]] const char* to_string(DigestStage stage);
/// @param place  Where the name was read, for the error message.
/// @throws core::InputError for a name that no stage has.
[[nodiscard]] DigestStage digest_stage_from(std::string_view name, const std::string& place);

}  // namespace segsim::experiments::reproducibility
