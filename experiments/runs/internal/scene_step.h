#pragma once

/// @file
/// The bundle of one scene: how it is made, and whether it is there.

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "experiments/specs/spec.h"
#include "experiments/support/step_record.h"
#include "experiments/training/training_run.h"
#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::experiments::runs::internal {

/// Refuses a bundle that is missing, damaged, or for rendering and labels only: here, before
/// detectors are trained for it.
/// @throws core::InputError
void check_bundle(const std::filesystem::path& folder);

/// Of a scene with a source: captured, then reconstructed.
class SceneStep {
 public:
  /// @param spec, scene  Outlive this object.
  SceneStep(const specs::ExperimentSpec& spec, const specs::SceneSpec& scene,
            const std::filesystem::path& work);

  [[nodiscard]] const specs::SceneSpec& scene() const { return scene_; }
  [[nodiscard]] bool is_current() const;
  [[nodiscard]] bool needs_capture() const;

  /// What all reconstructions of the scene are made from.
  void capture() const;
  void reconstruct() const;

  /// The recording, once it is captured.
  [[nodiscard]] std::unique_ptr<reconstruction::RgbdSequence> open_recording() const;
  /// How the scene is trained; its work folder is not set. None: lifted.
  [[nodiscard]] std::optional<training::TrainingOptions> training() const;

 private:
  [[nodiscard]] reconstruction::SequenceOptions reading() const;
  [[nodiscard]] std::string recipe() const;

  const specs::ExperimentSpec& spec_;
  const specs::SceneSpec& scene_;
  std::filesystem::path recording_;
  support::StepRecord record_;
};

}  // namespace segsim::experiments::runs::internal
