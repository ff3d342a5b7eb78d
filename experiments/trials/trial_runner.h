#pragma once

/// @file
/// The wiring: which renderer, detector and policy stand behind the interfaces of one trial,
/// and what is kept of it.

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "core/render.h"
#include "core/scene_bundle.h"
#include "core/stages.h"
#include "experiments/drawing/floor_plan.h"
#include "experiments/episodes/episodes.h"
#include "experiments/records/replay_log.h"
#include "experiments/records/store.h"
#include "experiments/records/trial_witness.h"
#include "experiments/specs/spec.h"
#include "experiments/trials/live_view.h"
#include "experiments/trials/policy_models.h"
#include "experiments/trials/prepared_detectors.h"
#include "experiments/trials/routed_detector.h"
#include "experiments/trials/shared_views.h"
#include "experiments/trials/trial_viewer.h"
#include "peers/peer.h"
#include "renderer/scene/panoptic_field.h"
#include "renderer/scene/surfels.h"
#include "sim/gazebo/gazebo_drive.h"
#include "sim/ground/world.h"
#include "sim/trial/oracle_detector.h"
#include "sim/trial/trial.h"

namespace segsim::experiments::trials {

/// A scene in memory: immutable, shared by all workers.
struct LoadedScene {
  const specs::SceneSpec* spec = nullptr;
  core::SceneBundle bundle;
  sim::World world;
  std::shared_ptr<const renderer::SurfelCloud> surfels;
  std::shared_ptr<const renderer::PanopticField> labels;  ///< nullptr: the surfels' own ids.
  drawing::FloorPlan plan;
  episodes::EpisodeSet episodes;
  std::string episodes_sha256;
  bool episodes_made = false;  ///< Now, and not found in a file.
  /// What the spec says, bound to this scene; nullptr: an exact camera alone.
  std::shared_ptr<const sim::SensorSettings> sensors;
};

/// Rules of the spec for one scene's episodes, without its phrases.
[[nodiscard]] episodes::EpisodeRules episode_rules(const specs::ExperimentSpec& spec,
                                                   const specs::SceneSpec& scene);

/// Loads a bundle and its episodes: those of `scene.episode_file`, or of
/// ${work}/episodes/<scene>.jsonl if that file was made by the same rules for the same bundle;
/// else they are generated and written there. Of a given file, lengths are those of the spec's
/// robot; what cannot be done gets l = infinity.
///
/// A second reconstruction of a scene has the episodes of the first, which must be there: the
/// same names, starts, goals and view points, so that trials pair over reconstructions, with
/// lengths in this one; what cannot be done here gets l = infinity.
/// @throws core::InputError if the episode file belongs to another bundle or names a class
/// that the bundle lacks.
[[nodiscard]] LoadedScene load_scene(const specs::ExperimentSpec& spec,
                                     const specs::SceneSpec& scene,
                                     const std::filesystem::path& bundle_folder,
                                     const std::filesystem::path& work);

/// Where its episodes start.
[[nodiscard]] Starts starts_of(const LoadedScene& scene);

/// One cell of the experiment; what it points to outlives it.
struct TrialTask {
  const LoadedScene* scene = nullptr;
  const sim::Episode* episode = nullptr;
  const specs::ArmSpec* arm = nullptr;
  int repetition = 0;
  bool video = false;
  bool frames = false;
  bool replay_log = false;  ///< Write one, see replay_log.h.
  const records::ReplayLog* replay =
      nullptr;                     ///< Play this trial again: measured times come from it.
  bool replay_perception = false;  ///< Detections (and images, if kept) too.
  std::filesystem::path replay_images{};  ///< Where they are; empty: the renderer draws.
  bool record = true;             ///< Picture, track and log, where the spec wants them.
  TrialViewer* viewer = nullptr;  ///< Of this trial; does not change it.
};

/// That which the arm runs.
[[nodiscard]] const nav::PolicyChoice& policy_of(const specs::ExperimentSpec& spec,
                                                 const specs::ArmSpec& arm);

/// Weights of an arm in a scene; empty for the oracle. @param scene  Its name.
[[nodiscard]] PreparedWeights weights_of(const specs::ArmSpec& arm, const std::string& scene,
                                         const PreparedDetectors& detectors);

/// Runs trials one after another: one object per thread, with renderers and detectors of its
/// own.
class TrialRunner {
 public:
  /// @param views_bytes  Memory for images that several arms of an episode see.
  TrialRunner(const specs::ExperimentSpec& spec, PreparedDetectors detectors,
              std::filesystem::path work,
              std::size_t views_bytes = SharedViews::kCapacity_bytes);

  /// Draws a scene by something else than the spec's backend.
  void set_renderer(const std::string& scene, std::unique_ptr<core::Renderer> renderer);

  /// The result depends on the task and the spec only. Writes picture, track, video and
  /// frames. What a trial throws becomes a row with outcome "error".
  [[nodiscard]] records::TrialRow run(const TrialTask& task);

 private:
  struct ArmDetectorSlot {
    std::unique_ptr<core::Detector> detector;
    sim::GroundTruthSink* truth = nullptr;  ///< The oracle itself.
    RoutedDetector* routed = nullptr;       ///< The detector, if it is one of two.
    std::shared_ptr<peers::Peer> process;   ///< Behind the detector; null: it is none.
  };
  core::Renderer& renderer_for(const LoadedScene& scene);
  /// What the robot sees by: views that an arm before it has seen are not drawn again.
  core::Renderer& eye_for(const TrialTask& task);
  ArmDetectorSlot& detector_for(const LoadedScene& scene, const specs::ArmSpec& arm);
  /// Gazebo, if it moves the robot, else null.
  sim::ExternalDrive* drive();
  std::unique_ptr<core::Policy> policy_for(const TrialTask& task, const ArmDetectorSlot& slot);
  void run_checked(const TrialTask& task, records::TrialRow& row);
  /// The result under the spec's success rule, and why it failed.
  records::Attribution judge_trial(const TrialTask& task, const sim::Episode& episode,
                                   int goal_index, const records::TrialWitness& witness,
                                   sim::TrialResult& result,
                                   std::vector<double>& distance_m) const;

  const specs::ExperimentSpec& spec_;
  PreparedDetectors detectors_;
  std::filesystem::path work_;
  std::size_t views_bytes_;
  LiveView live_;
  std::map<std::string, std::unique_ptr<core::Renderer>> renderers_;  ///< By scene.
  std::optional<SharedViews> views_;  ///< Of the episode that ran last.
  std::string views_of_;              ///< Its scene and name.
  LoadedPolicyModels models_;
  std::unique_ptr<sim::GazeboDrive> drive_;  ///< Made when it is needed.
  std::map<std::string, ArmDetectorSlot>
      slots_;  ///< By arm; those that differ between scenes by scene and arm.
};

}  // namespace segsim::experiments::trials
