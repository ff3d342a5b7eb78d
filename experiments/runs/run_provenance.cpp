#include "experiments/runs/run_provenance.h"

#include <algorithm>
#include <set>
#include <span>

#include <sqlite3.h>
#include <unistd.h>
#include <zlib.h>
#include <opencv2/core/version.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/input/regular_file.h"
#include "core/process/kernel_choice.h"
#include "core/process/measurement_record.h"
#include "experiments/detection/weights_exposure.h"
#include "experiments/specs/clock_spec.h"
#include "experiments/specs/tuning_set.h"
#include "experiments/trials/policy_models.h"
#include "experiments/trials/python_peer.h"
#include "experiments/trials/trial_runner.h"
#include "nav/policies/built_in_policies.h"
#include "perception/detector/library_versions.h"
#include "perception/models/model_description.h"
#include "renderer/scene/simd_target.h"
#include "worlds/mesh/library_versions.h"

namespace segsim::experiments::runs {
namespace {

/// Rows of the provenance: "program/<arm>/<file>".
const std::string kProgram = "program/";

/// What the weights of an arm were made from, as far as this run knows.
std::string training_scenes(const specs::ExperimentSpec& spec, const specs::ArmSpec& arm) {
  const specs::DetectorSpec& detectors = spec.detectors;
  std::string before = detectors.pretrain ? std::to_string(detectors.pretrain->rooms) +
                                                " procedural rooms, seed " +
                                                std::to_string(detectors.pretrain->seed)
                                          : std::string("those of the given weights");
  switch (arm.detector) {
    case specs::ArmDetector::kOracle:
      return "none (oracle)";
    case specs::ArmDetector::kFile:
      return "those of the given weights";
    case specs::ArmDetector::kProcess:
      return "unknown (another program)";
    case specs::ArmDetector::kBefore:
      return before;
    case specs::ArmDetector::kAfterHere:
      return before + ", in every scene this scene";
    case specs::ArmDetector::kAfter:
    case specs::ArmDetector::kAfterExact:
    case specs::ArmDetector::kAfterElsewhere:
      break;
  }
  if (!detectors.finetune) return "those of the given weights";
  std::string scenes;
  for (const std::string& scene : detectors.finetune->scenes) scenes += ", " + scene;
  if (arm.detector == specs::ArmDetector::kAfterElsewhere)
    scenes += ", in each of these without its own fold";
  return before + scenes;
}

std::vector<detection::EvaluationScene> evaluation_scenes(
    const std::vector<trials::LoadedScene>& scenes) {
  std::vector<detection::EvaluationScene> evaluated;
  for (const trials::LoadedScene& scene : scenes) {
    evaluated.push_back({scene.spec->name, &scene.bundle.manifest});
    const std::optional<specs::SourceSpec>& source = scene.spec->source;
    if (source && source->type == specs::SourceType::kFlat)
      evaluated.back().flat_seed = source->seed;
  }
  return evaluated;
}

/// Scenes of the arm's reconstruction which, in any reconstruction, are among those `seen`:
/// views of one show the place.
std::vector<std::string> own_scenes(const specs::ExperimentSpec& spec,
                                    const specs::ArmSpec& arm,
                                    const std::vector<std::string>& seen) {
  std::vector<std::string> own;
  for (const specs::SceneSpec& scene : spec.scenes) {
    if (scene.reconstruction != arm.reconstruction) continue;
    if (std::any_of(seen.begin(), seen.end(), [&](const std::string& name) {
          return spec.find_scene(name)->family == scene.family;
        })) {
      own.push_back(scene.name);
    }
  }
  return own;
}

/// What an arm's weights have seen of the scenes that it runs in.
records::SceneExposure exposure_of_arm(const specs::ExperimentSpec& spec,
                                       const specs::ArmSpec& arm,
                                       const std::filesystem::path& weights,
                                       std::span<const detection::EvaluationScene> scenes) {
  records::SceneExposure exposure = detection::exposure_of(weights, scenes);
  exposure.trained_on = own_scenes(spec, arm, exposure.trained_on);
  exposure.threshold_on = own_scenes(spec, arm, exposure.threshold_on);
  exposure.same_name = own_scenes(spec, arm, exposure.same_name);
  std::erase_if(exposure.same_name,
                [&](const std::string& name) { return exposure.is_trained_on(name); });
  return exposure;
}

/// SHA-256 of the files that a command line names: scripts, above all.
std::map<std::string, std::string> file_hashes(const core::PeerCommand& command) {
  std::map<std::string, std::string> hashes;
  std::vector<std::string> files = trials::runnable(command).command;
  std::string module = command.python.substr(0, command.python.find(':'));
  std::replace(module.begin(), module.end(), '.', '/');
  if (!module.empty()) files.push_back(command.folder / (module + ".py"));
  for (const std::filesystem::path file : files) {
    if (core::can_be_read(file)) hashes[file.filename()] = core::sha256_of_file(file);
  }
  return hashes;
}

/// The row of an arm that has the same weights everywhere, or none.
void add_file(const specs::ExperimentSpec& spec, const specs::ArmSpec& arm,
              const trials::PreparedDetectors& detectors,
              std::span<const detection::EvaluationScene> evaluated, records::ArmRow& row) {
  const trials::PreparedWeights weights = trials::weights_of(arm, {}, detectors);
  if (arm.detector == specs::ArmDetector::kProcess) {
    row.detector = "process " + arm.process.in_words();
    std::string text = row.detector;
    for (const auto& [name, sha256] : file_hashes(arm.process)) {
      text += "\n" + name + " " + sha256;
    }
    row.weights_sha256 = core::sha256_hex(text);
    row.exposure = records::SceneExposure{.known = records::TrainingDataKnown::kNothing};
  } else if (weights.file.empty()) {
    row.detector = "oracle";
  } else {
    row.detector = weights.file.filename().string();
    row.weights_sha256 = core::sha256_of_file(weights.file);
    row.exposure = exposure_of_arm(spec, arm, weights.file, evaluated);
  }
  if (!arm.open_detector.empty()) {
    row.detector += ", then " + arm.open_detector.filename().string();
  }
  row.held_out = weights.held_out;
  row.start_leak = weights.start_leak;
}

void add_if_among(const std::vector<std::string>& names, const std::string& wanted,
                  std::vector<std::string>& to) {
  if (std::find(names.begin(), names.end(), wanted) != names.end()) to.push_back(wanted);
}

/// Of an arm with several files the table shows the means of these.
constexpr double records::HeldOutPrecision::*kMeanFigures[] = {
    &records::HeldOutPrecision::ap50, &records::HeldOutPrecision::ap,
    &records::HeldOutPrecision::score_threshold, &records::HeldOutPrecision::precision,
    &records::HeldOutPrecision::recall};

/// The row of an arm that has weights of its own in every scene. What they had seen counts in
/// the scene that they decide in: of others they may well have.
void add_scenes(const specs::ExperimentSpec& spec, const specs::ArmSpec& arm,
                const trials::PreparedDetectors& detectors,
                std::span<const detection::EvaluationScene> evaluated, records::ArmRow& row) {
  std::string hashes;
  std::set<std::filesystem::path> files;
  records::SceneExposure all;
  records::HeldOutPrecision mean;
  records::StartLeak leak;
  int scenes = 0, measured = 0;
  for (const specs::SceneSpec& scene : spec.scenes) {
    if (scene.reconstruction != arm.reconstruction) continue;
    const trials::PreparedWeights weights = trials::weights_of(arm, scene.name, detectors);
    ++scenes;
    files.insert(weights.file);
    hashes += scene.name + " " + core::sha256_of_file(weights.file) + "\n";
    const records::SceneExposure one = exposure_of_arm(spec, arm, weights.file, evaluated);
    add_if_among(one.trained_on, scene.name, all.trained_on);
    add_if_among(one.threshold_on, scene.name, all.threshold_on);
    add_if_among(one.same_name, scene.name, all.same_name);
    all.known = std::max(all.known, one.known);
    if (weights.start_leak) {
      leak.views += weights.start_leak->views;
      leak.near_starts += weights.start_leak->near_starts;
      leak.radius_m = weights.start_leak->radius_m;
    }
    if (!weights.held_out) continue;
    ++measured;
    mean.views += weights.held_out->views;
    for (const auto value : kMeanFigures) {
      mean.*value += (*weights.held_out).*value;
    }
  }
  for (const auto value : kMeanFigures) {
    mean.*value /= std::max(1, measured);
  }
  row.detector = std::to_string(files.size()) + " files for " + std::to_string(scenes) +
                 (scenes == 1 ? " scene" : " scenes");
  row.weights_sha256 = core::sha256_hex(hashes);
  row.exposure = all;
  if (measured > 0) row.held_out = mean;
  if (leak.views > 0) row.start_leak = leak;
}

/// Adds the SHA-256 of what a network of others consists of.
void add_hashes(const std::filesystem::path& model,
                std::map<std::string, std::string>& hashes) {
  hashes[model.filename()] = core::sha256_of_file(model);
  for (const auto& [role, file] : perception::read_model_description(model).files) {
    hashes[file.filename()] = core::sha256_of_file(file);
  }
}

/// Of those that policies, second detectors and phrases name.
std::map<std::string, std::string> model_hashes(const specs::ExperimentSpec& spec) {
  std::map<std::string, std::string> hashes;
  for (const specs::ArmSpec& arm : spec.arms) {
    for (const auto& model : trials::model_files(trials::policy_of(spec, arm))) {
      add_hashes(model, hashes);
    }
    if (!arm.open_detector.empty()) add_hashes(arm.open_detector, hashes);
  }
  if (!spec.phrases.model.empty()) add_hashes(spec.phrases.model, hashes);
  return hashes;
}

}  // namespace

std::string host_and_processor() {
  char name[256] = {};
  const bool known = gethostname(name, sizeof name - 1) == 0;
  return std::string(known ? name : "unknown") + ", " + core::processor_name();
}

std::string library_versions() {
  return std::string("compiler " __VERSION__ "; OpenCV " CV_VERSION "; SQLite ") +
         sqlite3_libversion() + "; zlib " + zlibVersion() + "; SIMD " +
         renderer::simd_target();
}

std::map<std::string, std::string> program_provenance(const specs::ExperimentSpec& spec) {
  std::map<std::string, std::string> rows;
  for (const specs::ArmSpec& arm : spec.arms) {
    const nav::PolicyChoice& policy = trials::policy_of(spec, arm);
    const auto* other = policy.settings<nav::ProcessSettings>();
    if (other == nullptr) continue;
    for (const auto& [name, sha256] : file_hashes(other->peer)) {
      rows[kProgram + arm.name + "/" + name] = sha256;
    }
  }
  return rows;
}

std::map<std::string, std::string> run_provenance(const specs::ExperimentSpec& spec,
                                                  const std::optional<Shard>& shard) {
  std::map<std::string, std::string> rows;
  const std::string clock = specs::clock_in_words(spec.clock);
  rows["kernels"] = core::to_string(core::kernel_choice());
  rows["clock"] = clock.empty() ? "lockstep" : clock;
  const auto add_libraries = [&](const std::map<std::string, std::string>& versions) {
    for (const auto& [name, version] : versions) rows["library/" + name] = version;
  };
  add_libraries(perception::library_versions());
  add_libraries(worlds::library_versions());
  add_libraries({{"SQLite", sqlite3_libversion()},
                 {"zlib", zlibVersion()},
                 {"compiler", __VERSION__},
                 {"SIMD", renderer::simd_target()}});
  for (const specs::ArmSpec& arm : spec.arms) {
    rows["training_scenes/" + arm.name] = training_scenes(spec, arm);
  }
  for (const auto& [name, sha256] : model_hashes(spec)) rows["model/" + name] = sha256;
  rows.merge(program_provenance(spec));
  if (shard) rows["shard"] = shard->text();
  return rows;
}

std::vector<records::SceneRow> scene_rows(const std::vector<trials::LoadedScene>& scenes) {
  std::vector<records::SceneRow> rows;
  for (const trials::LoadedScene& scene : scenes) {
    rows.push_back({scene.spec->name, scene.spec->title, scene.bundle.scene_sha256,
                    scene.episodes_sha256,
                    static_cast<std::int64_t>(scene.episodes.episodes.size())});
    rows.back().family = scene.spec->family;
    rows.back().reconstruction = scene.spec->reconstruction;
    if (scene.episodes.oracle) {
      rows.back().oracle_successes = scene.episodes.oracle->successes;
      rows.back().oracle_episodes = scene.episodes.oracle->episodes;
    }
  }
  return rows;
}

std::vector<records::ArmRow> arm_rows(const specs::ExperimentSpec& spec,
                                      const trials::PreparedDetectors& detectors,
                                      const std::vector<trials::LoadedScene>& scenes) {
  const std::vector<detection::EvaluationScene> evaluated = evaluation_scenes(scenes);
  std::vector<records::ArmRow> rows;
  for (const specs::ArmSpec& arm : spec.arms) {
    records::ArmRow row;
    row.name = arm.name;
    row.family = arm.family;
    row.reconstruction = arm.reconstruction;
    row.finetune_seed = arm.finetune_seed;
    if (specs::is_tuned_by_scene(arm.detector)) {
      add_scenes(spec, arm, detectors, evaluated, row);
    } else {
      add_file(spec, arm, detectors, evaluated, row);
    }
    for (const specs::SceneSpec& scene : spec.scenes) {
      if (spec.leaks(arm, scene) || (row.exposure && row.exposure->is_trained_on(scene.name)))
        row.tuned_on += (row.tuned_on.empty() ? "" : ", ") + scene.name;
    }
    row.score_threshold = arm.score_threshold.value_or(-1.0);
    rows.push_back(std::move(row));
  }
  return rows;
}

std::map<std::string, std::string> generalisation_provenance(
    const specs::ExperimentSpec& spec, const trials::PreparedDetectors& detectors) {
  std::map<std::string, std::string> rows;
  for (const specs::SceneSpec& scene : spec.scenes) {
    if (!scene.pool.empty()) rows["pool/" + scene.family] = scene.pool;
    for (const specs::ArmSpec& arm : spec.arms) {
      const bool runs = scene.reconstruction == arm.reconstruction;
      if (!runs || !specs::is_tuned_by_scene(arm.detector)) continue;
      rows["weights/" + arm.name + "/" + scene.name] =
          core::sha256_of_file(trials::weights_of(arm, scene.name, detectors).file);
    }
  }
  return rows;
}

/// Refuses to go on with a run whose inputs are not what they were.
void check_same_programs(const std::map<std::string, std::string>& before,
                         const std::map<std::string, std::string>& after) {
  for (const auto& [name, sha256] : after) {
    const auto began = before.find(name);
    if (!name.starts_with(kProgram) || began == before.end() || began->second == sha256)
      continue;
    throw core::InputError::expected(name,
                                     "the file that the run began with, SHA-256 " +
                                         began->second + " (--new begins another run)",
                                     sha256);
  }
}

void check_same_inputs(const records::Store& store, std::int64_t run_id,
                       const std::vector<records::SceneRow>& scenes,
                       const std::vector<records::ArmRow>& arms) {
  const auto refuse = [](const std::string& what) {
    throw core::InputError(what +
                           " changed since the run began: finished trials and new ones "
                           "would not compare. Give --new to begin another run.");
  };
  const std::vector<records::SceneRow> old_scenes = store.scenes(run_id);
  for (std::size_t i = 0; i < scenes.size() && i < old_scenes.size(); ++i) {
    if (scenes[i].scene_sha256 != old_scenes[i].scene_sha256)
      refuse("scene " + scenes[i].name);
    if (scenes[i].episodes_sha256 != old_scenes[i].episodes_sha256) {
      refuse("episodes of scene " + scenes[i].name);
    }
  }
  const std::vector<records::ArmRow> old_arms = store.arms(run_id);
  for (std::size_t i = 0; i < arms.size() && i < old_arms.size(); ++i) {
    if (arms[i].weights_sha256 != old_arms[i].weights_sha256) {
      refuse("weights of arm " + arms[i].name);
    }
  }
}

}  // namespace segsim::experiments::runs
