#pragma once

/// @file
/// What is stored of a run besides its trials: the run itself, its scenes, its arms.

#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "experiments/records/column.h"
#include "experiments/records/held_out_precision.h"
#include "experiments/records/scene_exposure.h"

namespace segsim::experiments::records {

/// Where the numbers come from. `libraries`, `host`: free text.
struct RunRow {
  std::int64_t run_id = 0;
  std::string name, title;
  std::string spec_sha256, spec_text;
  std::string code_version, host, libraries;
  std::string success_profile;  ///< In words, with its parameters.
  std::uint64_t seed = 0;
  int planned_n = 0;           ///< Episodes per arm and scene; 0 = all.
  int planned_trials = 0;      ///< Over all arms.
  std::string started, ended;  ///< UTC, ISO 8601; `ended` is empty while trials are missing.
  /// What else a result may depend on, by name: "clock", "library/<name>",
  /// "training_scenes/<arm>", "leakage/<arm>" (from ArmRow::exposure), "time/<stage>",
  /// "shard"; of merged runs "merged/<shard>"; "pool/<scene>"; "weights/<arm>/<scene>" of arms
  /// that have weights of their own in every scene (ArmRow::weights_sha256 is then of all);
  /// "masks/<scene>" where fine-tuning learns a scene from masks.
  std::map<std::string, std::string> provenance{};
};

struct SceneRow {
  std::string name, title;
  std::string scene_sha256;     ///< Of the bundle's manifest.
  std::string episodes_sha256;  ///< Of the episode file.
  std::int64_t episodes = 0;
  /// Of the set's validation by the oracle-path arm; -1: not validated.
  int oracle_successes = -1, oracle_episodes = -1;
  std::string family{};    ///< Of all reconstructions of one scene; empty means `name`.
  int reconstruction = 1;  ///< Which of them this is.
};

struct ArmRow {
  std::string name;
  std::string detector;        ///< "oracle" or the name of the weight file.
  std::string weights_sha256;  ///< Empty for the oracle.
  std::string
      tuned_on;  ///< Names of scenes whose views it was fine-tuned on, with ", " between.
  double score_threshold = -1;               ///< -1: the one stored with the weights.
  std::optional<HeldOutPrecision> held_out;  ///< None for the oracle and foreign weights.
  std::optional<StartLeak> start_leak{};     ///< None if it was not fine-tuned here.
  /// None for the oracle, and in results of versions that did not look.
  std::optional<SceneExposure> exposure{};
  std::string family{};    ///< Of all trainings of one arm of the spec; empty means `name`.
  int reconstruction = 1;  ///< It ran in these scenes only.
  std::optional<std::uint64_t> finetune_seed{};  ///< None if it was not fine-tuned here.
};

/// Of a SceneRow or ArmRow.
template <class Row>
[[nodiscard]] const std::string& family_of(const Row& row) {
  return row.family.empty() ? row.name : row.family;
}

/// The provenance is a table of its own.
template <AnyConst<RunRow> Row, class F>
void visit_columns(Row& run, F&& f) {
  f({.name = "run_id", .given_by_store = true}, run.run_id);
  f({.name = "name"}, run.name);
  f({.name = "title"}, run.title);
  f({.name = "spec_sha256"}, run.spec_sha256);
  f({.name = "spec_text"}, run.spec_text);
  f({.name = "code_version"}, run.code_version);
  f({.name = "host"}, run.host);
  f({.name = "libraries"}, run.libraries);
  f({.name = "success_profile"}, run.success_profile);
  f({.name = "seed"}, run.seed);
  f({.name = "planned_n"}, run.planned_n);
  f({.name = "planned_trials"}, run.planned_trials);
  f({.name = "started"}, run.started);
  f({.name = "ended"}, run.ended);
}

template <AnyConst<SceneRow> Row, class F>
void visit_columns(Row& scene, F&& f) {
  f({.name = "name"}, scene.name);
  f({.name = "title"}, scene.title);
  f({.name = "scene_sha256"}, scene.scene_sha256);
  f({.name = "episodes_sha256"}, scene.episodes_sha256);
  f({.name = "episodes"}, scene.episodes);
  f({.name = "oracle_successes"}, scene.oracle_successes);
  f({.name = "oracle_episodes"}, scene.oracle_episodes);
  f({.name = "family"}, scene.family);
  f({.name = "reconstruction"}, scene.reconstruction);
}

}  // namespace segsim::experiments::records
