#pragma once

/// @file
/// One step of training on batches that somebody else makes: forward pass, loss, derivatives,
/// clipping, optimiser, average. Knows neither files nor pictures.
///
/// On CUDA a batch travels through page-locked memory. With mixed precision the forward pass
/// is in float16 where it is safe and the loss is scaled, so that small derivatives survive
/// (Micikevicius et al. 2018, "Mixed precision training").

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "perception/internal/network/torch_device.h"
#include "perception/training/internal/batch.h"
#include "perception/training/internal/trainable_network.h"
#include "perception/training/training.h"

namespace segsim::perception {

class TrainingStep {
 public:
  /// Fills the batch of this number, counted over the whole training.
  using MakeBatch = std::function<void(std::int64_t number, Batch& batch)>;

  /// @param options  Resolved; outlives this object.
  /// @param network, average  Of equal tensors; both are moved to the options' device.
  /// @param from_scratch  Whether the batch norms' statistics are still unknown.
  /// @throws core::InputError if the options ask for CUDA and there is none.
  TrainingStep(const TrainOptions& options, TrainableNetwork network, TrainableNetwork average,
               bool from_scratch);

  /// One step. @returns the loss per image, nullopt if it or its derivative is no number: then
  /// nothing has moved.
  std::optional<double> advance(const MakeBatch& make);

  // The state of a run.
  TrainableNetwork network, average;
  std::unique_ptr<torch::optim::Optimizer> optimizer;
  std::int64_t step = 0;  ///< Steps done.
  double loss_scale = 65536.0;
  int steps_since_scale = 0;

 private:
  [[nodiscard]] torch::Tensor batch_loss(std::int64_t number, const MakeBatch& make);
  [[nodiscard]] torch::Tensor batch_on_device();
  [[nodiscard]] NetworkOutput forward(std::int64_t number, const torch::Tensor& input);
  [[nodiscard]] torch::Tensor mean_loss(const RawOutput& output) const;
  [[nodiscard]] torch::Tensor mean_loss(const HeatMaps& maps) const;
  bool finish_gradients();
  void adapt_loss_scale(bool finite);
  [[nodiscard]] double norm_momentum(std::int64_t batches_done) const;
  void update_average();

  const TrainOptions& options_;
  torch::Device device_;
  bool from_scratch_;
  std::vector<ParameterGroup> groups_;  ///< In the optimiser's order.
  Anchors anchors_;
  Batch batch_;
  torch::Tensor staging_;  ///< Page-locked; only on CUDA.
};

}  // namespace segsim::perception
