#include "experiments/runs/internal/run_checks.h"

#include <algorithm>
#include <optional>
#include <vector>

#include "core/error.h"
#include "experiments/specs/tuning_set.h"
#include "experiments/support/listed.h"
#include "experiments/trials/arm_detector.h"
#include "experiments/trials/policy_models.h"
#include "experiments/trials/python_peer.h"
#include "peers/peer.h"
#include "perception/models/image_text_scorer.h"

namespace segsim::experiments::runs::internal {

void check_goals_known(const specs::ExperimentSpec& spec, const Inputs& inputs) {
  for (const specs::ArmSpec& arm : spec.arms) {
    if (arm.detector == specs::ArmDetector::kOracle || trials::is_prompted(arm)) continue;
    std::optional<std::vector<std::string>> known;
    for (const trials::LoadedScene& scene : inputs.scenes) {
      if (scene.spec->reconstruction != arm.reconstruction) continue;
      if (!known || arm.detector == specs::ArmDetector::kProcess) {
        known = trials::load_arm_detector(arm, inputs.detectors, scene,
                                          trials::compute_device(spec))
                    ->class_names();
        if (arm.detector == specs::ArmDetector::kBefore) {  // That is told in the table.
          known->insert(known->end(), inputs.new_classes.begin(), inputs.new_classes.end());
        }
      }
      std::vector<std::string> names = *known;
      if (!arm.open_detector.empty()) {
        const auto open = trials::load_open_detector(arm, scene);
        names.insert(names.end(), open->class_names().begin(), open->class_names().end());
      }
      const auto unknown = trials::unknown_goals(trials::searched_classes(scene), names);
      if (unknown.empty()) continue;
      throw core::InputError::expected("scene " + scene.spec->name + ", arm " + arm.name,
                                       "goals that its detector knows (" +
                                           support::listed(names) + "), or fine-tuning in " +
                                           "that scene, which teaches new ones",
                                       support::listed(unknown));
    }
  }
}

namespace {

/// @throws core::InputError if a run cannot have this policy.
void check_network(const specs::ExperimentSpec& spec, const specs::ArmSpec& arm, int workers) {
  const auto* network = trials::policy_of(spec, arm).settings<nav::Ros2Settings>();
  if (network == nullptr) return;
  const std::string place = "arm " + arm.name + ", policy ros2";
  if (workers > 1) {
    throw core::InputError::expected(place,
                                     "--workers 1, because a network of ROS 2 has one robot",
                                     std::to_string(workers) + " workers");
  }
  const sim::TrialClock clock = specs::trial_clock(spec.clock, arm.clock);
  if (!network->waits && clock.mode != sim::ClockMode::kRealtime) {
    throw core::InputError::expected(place,
                                     "clock: realtime for `commands: newest`, or `each`",
                                     std::string(sim::to_string(clock.mode)));
  }
}

}  // namespace

void check_motion(const specs::ExperimentSpec& spec, int workers) {
  if (!spec.motion || workers == 1) return;
  throw core::InputError::expected("motion by Gazebo",
                                   "--workers 1, because a world has one robot",
                                   std::to_string(workers) + " workers");
}

void check_policy_models(const specs::ExperimentSpec& spec, int workers) {
  if (!spec.phrases.model.empty()) {
    (void)perception::load_image_text_scorer(spec.phrases.model);
  }
  trials::LoadedPolicyModels models;
  std::vector<std::string> goals;  // Of all scenes; unknown where a file has the episodes.
  for (const specs::SceneSpec& scene : spec.scenes) {
    goals.insert(goals.end(), scene.goals.begin(), scene.goals.end());
  }
  for (const specs::ArmSpec& arm : spec.arms) {
    check_network(spec, arm, workers);
    models.load(trials::policy_of(spec, arm));
    if (arm.detector != specs::ArmDetector::kProcess || goals.empty()) continue;
    peers::Peer(trials::runnable(arm.process), "detector", goals).start();
  }
}

std::string untaught_goals(const specs::ExperimentSpec& spec, const Inputs& inputs) {
  const bool elsewhere =
      std::any_of(spec.arms.begin(), spec.arms.end(), [](const specs::ArmSpec& arm) {
        return arm.detector == specs::ArmDetector::kAfterElsewhere;
      });
  std::string text;
  if (!elsewhere) return text;
  for (const trials::LoadedScene& scene : inputs.scenes) {
    if (scene.spec->reconstruction != 1) continue;
    const specs::TuningSet set =
        specs::tuning_set(spec, specs::ArmDetector::kAfterElsewhere, *scene.spec);
    std::vector<std::string> taught;
    for (const trials::LoadedScene& other : inputs.scenes) {
      const std::string& family = other.spec->family;
      if (std::find(set.scenes.begin(), set.scenes.end(), family) == set.scenes.end())
        continue;
      for (const core::SceneClass& c : other.bundle.manifest.classes) taught.push_back(c.name);
    }
    std::vector<std::string> untaught =
        trials::unknown_goals(trials::searched_classes(scene), taught);
    std::erase_if(untaught, [&](const std::string& name) {
      const std::vector<std::string>& added = inputs.new_classes;
      return std::find(added.begin(), added.end(), name) == added.end();
    });
    if (untaught.empty()) continue;
    text += (text.empty() ? "" : "; ") + scene.spec->title + ": " + support::listed(untaught);
  }
  return text;
}

}  // namespace segsim::experiments::runs::internal
