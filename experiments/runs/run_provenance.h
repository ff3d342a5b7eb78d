#pragma once

/// @file
/// Where the numbers of a run come from: what the store keeps of it, and whether a run that
/// goes on still has the inputs that it began with.

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "experiments/records/store.h"
#include "experiments/runs/prepare.h"
#include "experiments/runs/shard.h"
#include "experiments/specs/spec.h"
#include "experiments/trials/trial_runner.h"

namespace segsim::experiments::runs {

[[nodiscard]] std::string host_and_processor();
/// What results may depend on and a version of segsim does not fix, in one line.
[[nodiscard]] std::string library_versions();
/// RunRow::provenance of a run that begins here and now.
[[nodiscard]] std::map<std::string, std::string> run_provenance(
    const specs::ExperimentSpec& spec, const std::optional<Shard>& shard);

/// The part of it that is SHA-256 of files of other programs that decide in place of policies:
/// "program/<arm>/<file>".
[[nodiscard]] std::map<std::string, std::string> program_provenance(
    const specs::ExperimentSpec& spec);

[[nodiscard]] std::vector<records::SceneRow> scene_rows(
    const std::vector<trials::LoadedScene>& scenes);
/// @param scenes  That the arms are evaluated in: what an arm has seen of them is looked up.
[[nodiscard]] std::vector<records::ArmRow> arm_rows(
    const specs::ExperimentSpec& spec, const trials::PreparedDetectors& detectors,
    const std::vector<trials::LoadedScene>& scenes);

/// RunRow::provenance of weights that are others in every scene: "weights/<arm>/<scene>", and
/// of pools: "pool/<family of scenes>".
[[nodiscard]] std::map<std::string, std::string> generalisation_provenance(
    const specs::ExperimentSpec& spec, const trials::PreparedDetectors& detectors);

/// Refuses to put together what programs that decide in place of policies made of which a file
/// was changed in between. @throws core::InputError
void check_same_programs(const std::map<std::string, std::string>& before,
                         const std::map<std::string, std::string>& after);

/// Refuses to go on with a run whose inputs are not what they were.
/// @throws core::InputError naming the scene or arm.
void check_same_inputs(const records::Store& store, std::int64_t run_id,
                       const std::vector<records::SceneRow>& scenes,
                       const std::vector<records::ArmRow>& arms);

}  // namespace segsim::experiments::runs
