#pragma once

/// @file
/// Reads from a detector's file what it has seen of the scenes that it is evaluated in.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>

#include "core/scene_bundle.h"
#include "experiments/records/scene_exposure.h"

namespace segsim::experiments::detection {

/// A scene of an evaluation.
struct EvaluationScene {
  std::string name;  ///< In the spec.
  const core::SceneManifest* manifest = nullptr;
  std::optional<std::uint64_t> flat_seed{};  ///< If it is a procedural flat.
};

/// @param weights  Of this program, or a model of others: that says nothing.
/// @throws core::InputError if the file or its record is damaged.
[[nodiscard]] records::SceneExposure exposure_of(const std::filesystem::path& weights,
                                                 std::span<const EvaluationScene> scenes);

}  // namespace segsim::experiments::detection
