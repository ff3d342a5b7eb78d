#pragma once

/// @file
/// The fine-tunings of a run: which there are, and making those that are not there.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "experiments/specs/spec.h"
#include "experiments/specs/tuning_set.h"
#include "experiments/support/stage_times.h"
#include "experiments/support/step_record.h"
#include "perception/data/compute_device.h"

namespace segsim::experiments::runs::internal {

/// Views of a procedural room, wherever such rooms are rendered.
inline constexpr int kViewsPerRoom = 8;

/// One draw of everything that is random in a fine-tuning: its views and its steps.
struct Training {
  int reconstruction = 1;
  std::uint64_t seed = 0;
  std::string suffix;      ///< Of its files.
  specs::TuningSet set{};  ///< That its views show.
};

/// The one whose detector the arm runs in the scene. The arm is fine-tuned by this run.
[[nodiscard]] Training training_in(const specs::ExperimentSpec& spec,
                                   const specs::ArmSpec& arm, const specs::SceneSpec& scene);
/// Each once, though several arms may run its detector.
[[nodiscard]] std::vector<Training> trainings_of(const specs::ExperimentSpec& spec);

/// One fine-tuning and whether it was done.
class FineTuning {
 public:
  /// @param views, validation  Data sets.
  /// @param new_classes  Those that `before` does not know: each gets a head of its own.
  FineTuning(const specs::ExperimentSpec& spec, std::filesystem::path before,
             std::vector<std::string> new_classes, std::filesystem::path views,
             std::filesystem::path validation, const Training& training,
             const std::filesystem::path& work);

  [[nodiscard]] const std::filesystem::path& output() const { return output_; }
  [[nodiscard]] bool is_current() const;

  /// @param mix  Data set of the source domain; empty: none is mixed in.
  void make(const std::filesystem::path& mix,
            const std::function<void(int, double)>& on_step) const;

 private:
  [[nodiscard]] std::string recipe() const;

  const specs::FinetuneSpec& finetune_;
  perception::ComputeDevice device_;
  std::filesystem::path before_, views_, validation_;
  std::vector<std::string> new_classes_;
  std::uint64_t seed_;
  std::filesystem::path output_;
  support::StepRecord record_;
};

/// Makes those that are not there: as many side by side as the workers have threads for.
void fine_tune(const specs::ExperimentSpec& spec, const std::vector<FineTuning>& steps,
               const std::filesystem::path& work, int workers, support::StageTimes& times);

}  // namespace segsim::experiments::runs::internal
