// Repetitions of a spec: one scene for each reconstruction, one arm for each training.
#include <algorithm>
#include <utility>

#include "experiments/specs/internal/spec_readers.h"
#include "experiments/specs/tuning_set.h"
#include "experiments/support/numbers_in_range.h"

namespace segsim::experiments::specs {
namespace {

using core::ConfigNode;

constexpr int kMostTrials = 10'000, kMostSeeds = 1'000;

void check_finetune_seeds(const ConfigNode& node, const ExperimentSpec& spec) {
  const int seeds = spec.repetitions.finetune_seeds;
  if (seeds == 1) return;
  const bool trains = spec.detectors.finetune &&
                      std::any_of(spec.arms.begin(), spec.arms.end(), [](const ArmSpec& arm) {
                        return is_fine_tuned(arm.detector);
                      });
  if (trains) return;
  node.child("finetune_seeds")
      .fail("1, or a section detectors.finetune and an arm with detector: after",
            std::to_string(seeds) + " without them");
}

/// Lifting draws nothing: a second one would be the first again.
void check_reconstruct_seeds(const ConfigNode& node, const ExperimentSpec& spec) {
  const int seeds = spec.repetitions.reconstruct_seeds;
  if (seeds == 1) return;
  for (const SceneSpec& scene : spec.scenes) {
    if (scene.source && scene.source->reconstruct) continue;
    node.child("reconstruct_seeds")
        .fail("1, or scenes with source.reconstruct (lifting draws nothing)",
              std::to_string(seeds) + ", but scene " + scene.name + " has none");
  }
}

SceneSpec reconstructed_again(const ExperimentSpec& spec, SceneSpec scene,
                              int reconstruction) {
  const std::string suffix = repetition_suffix(spec, reconstruction, std::nullopt);
  scene.reconstruction = reconstruction;
  scene.name += suffix;
  scene.title += ", reconstruction " + std::to_string(reconstruction);
  scene.bundle += suffix;
  scene.source->reconstruct->seed += static_cast<std::uint64_t>(reconstruction - 1);
  if (scene.source->masks) {  // Each begins with what a segmenter sees anew.
    scene.source->masks->seed += static_cast<std::uint64_t>(reconstruction - 1);
  }
  return scene;
}

/// The first reconstruction of all scenes comes first: an interrupted run has whole tables.
std::vector<SceneSpec> expanded_scenes(const ExperimentSpec& spec) {
  std::vector<SceneSpec> scenes = spec.scenes;
  for (int r = 2; r <= spec.repetitions.reconstruct_seeds; ++r) {
    for (const SceneSpec& scene : spec.scenes) {
      scenes.push_back(reconstructed_again(spec, scene, r));
    }
  }
  return scenes;
}

std::vector<ArmSpec> expanded_arms(const ExperimentSpec& spec) {
  std::vector<ArmSpec> arms;
  const auto add = [&](ArmSpec arm, int reconstruction,
                       std::optional<std::uint64_t> finetune_seed) {
    arm.reconstruction = reconstruction;
    arm.finetune_seed = finetune_seed;
    arm.name += repetition_suffix(spec, reconstruction, finetune_seed);
    arms.push_back(std::move(arm));
  };
  for (int r = 1; r <= spec.repetitions.reconstruct_seeds; ++r) {
    for (const ArmSpec& arm : spec.arms) {
      if (!is_fine_tuned(arm.detector) || !spec.detectors.finetune) {
        add(arm, r, std::nullopt);
        continue;
      }
      for (int k = 0; k < spec.repetitions.finetune_seeds; ++k) {
        add(arm, r, spec.detectors.finetune->seed + static_cast<std::uint64_t>(k));
      }
    }
  }
  return arms;
}

}  // namespace

std::string repetition_suffix(const ExperimentSpec& spec, int reconstruction,
                              std::optional<std::uint64_t> finetune_seed) {
  std::string suffix;
  if (reconstruction > 1) suffix += ".r" + std::to_string(reconstruction);
  if (finetune_seed && *finetune_seed != spec.detectors.finetune->seed) {
    suffix += ".s" + std::to_string(*finetune_seed);
  }
  return suffix;
}

namespace internal {

void read_repetitions(const ConfigNode& root, ExperimentSpec& spec) {
  RepetitionsSpec& repetitions = spec.repetitions;
  const std::optional<ConfigNode> node = root.optional_child("repetitions");
  if (node && node->is_map()) {
    repetitions.trials = support::count_within(*node, "trials", 1, 1, kMostTrials);
    repetitions.finetune_seeds =
        support::count_within(*node, "finetune_seeds", 1, 1, kMostSeeds);
    repetitions.reconstruct_seeds =
        support::count_within(*node, "reconstruct_seeds", 1, 1, kMostSeeds);
    node->finish();
    check_finetune_seeds(*node, spec);
    check_reconstruct_seeds(*node, spec);
  } else {
    repetitions.trials = support::count_within(root, "repetitions", 1, 1, kMostTrials);
  }
  // Both read the scenes and arms of the file.
  std::vector<SceneSpec> scenes = expanded_scenes(spec);
  spec.arms = expanded_arms(spec);
  spec.scenes = std::move(scenes);
}

}  // namespace internal
}  // namespace segsim::experiments::specs
