#pragma once

/// @file
/// Parts of spec.cpp: one reader for each section of a spec. All throw core::InputError with
/// file, line and key.

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "core/config.h"
#include "experiments/specs/spec.h"

namespace segsim::experiments::specs::internal {

/// Replaces ${data}, ${work} and ${spec} in a path.
class Variables {
 public:
  /// @param spec_file  Its folder is ${spec}.
  Variables(const SpecFolders& folders, const std::filesystem::path& spec_file);
  [[nodiscard]] std::filesystem::path expand(const core::ConfigNode& node) const;

 private:
  [[nodiscard]] std::string value_of(const std::string& name,
                                     const core::ConfigNode& node) const;

  std::vector<std::pair<std::string, std::string>> values_;
};

/// The key `seed`, >= 0.
[[nodiscard]] std::uint64_t read_seed(const core::ConfigNode& node, std::uint64_t fallback);
/// A name that can be part of a file name.
[[nodiscard]] std::string read_name(const core::ConfigNode& node, const std::string& key);

/// The keys of a recording's `source` that RigSpec has.
[[nodiscard]] RigSpec read_rig(const core::ConfigNode& source, const Variables& variables);
[[nodiscard]] SourceSpec read_source(const core::ConfigNode& node, const Variables& variables);
[[nodiscard]] SceneSpec read_scene(const core::ConfigNode& node, const Variables& variables,
                                   const SpecFolders& folders, const sim::RobotModel& robot);

/// The key `goals` of a scene: class names and phrases.
void read_goals(const core::ConfigNode& node, SceneSpec& scene);
/// The key `phrases` of the root, which must be there if, and only if, a goal is a phrase. To
/// be called when scenes and repetitions are in.
void read_phrase_model(const core::ConfigNode& root, const Variables& variables,
                       ExperimentSpec& spec);

/// The key `detectors` of the root. @param scenes  That fine-tuning may name.
[[nodiscard]] DetectorSpec read_detectors(const core::ConfigNode& root,
                                          const Variables& variables,
                                          const SpecFolders& folders,
                                          const std::vector<SceneSpec>& scenes);
/// The key `policy`.
[[nodiscard]] nav::PolicyChoice read_policy(const core::ConfigNode& node,
                                            const Variables& variables);
[[nodiscard]] ArmSpec read_arm(const core::ConfigNode& node, const Variables& variables);

/// The key `motion` of the root, for which clock, collision and replays must be right. To be
/// called when all else is in.
void read_motion(const core::ConfigNode& root, ExperimentSpec& spec);

/// The key `repetitions` of the root: fills in spec.repetitions and makes scenes and arms of
/// it. To be called when scenes, detectors and arms are in.
void read_repetitions(const core::ConfigNode& root, ExperimentSpec& spec);

}  // namespace segsim::experiments::specs::internal
