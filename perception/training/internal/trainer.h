#pragma once

/// @file
/// One run of training: network, its average, optimiser, streams and step, which together are
/// the state on disk. Without torch in the interface.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>

#include "perception/training/internal/training_inputs.h"

namespace segsim::perception {

/// The best evaluation so far.
struct BestSoFar {
  std::int64_t step = 0;  ///< 0: none.
  double fitness = 0.0;
  int without_better = 0;  ///< Evaluations since.
};

class Trainer {
 public:
  /// Continues from the state file if there is one. @param options  Resolved.
  /// @throws core::InputError for a device that is not there, or a state of another run.
  Trainer(const TrainOptions& options, const TrainingInputs& inputs);
  ~Trainer();
  Trainer(const Trainer&) = delete;
  Trainer& operator=(const Trainer&) = delete;

  /// One step. @returns the loss per image, nullopt if it or its derivative is no number: then
  /// nothing has moved.
  std::optional<double> advance();
  [[nodiscard]] std::int64_t step() const;
  [[nodiscard]] std::int64_t parameter_count() const;
  /// The average.
  [[nodiscard]] DetectorWeights weights() const;

  [[nodiscard]] std::filesystem::path state_file() const;
  void save_state() const;
  BestSoFar best;  ///< Part of the state.

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace segsim::perception
