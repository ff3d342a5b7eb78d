#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "perception/internal/loss/assigner.h"
#include "perception/internal/network/network_output.h"
#include "perception/training/training.h"

namespace segsim::perception {

/// A network of any kind, as training sees it.
struct TrainableNetwork {
  std::shared_ptr<torch::nn::Module> module;
  std::function<NetworkOutput(const torch::Tensor&)> forward;
  AssignerRule rule;                                ///< For networks with anchors.
  std::function<void(std::uint64_t)> seed_dropout;  ///< Before forward(); empty without any.
};

/// At the start of training. @param architecture  As in a weights file; one that exists.
[[nodiscard]] TrainableNetwork make_trainable_network(const std::string& architecture,
                                                      double width, int class_count,
                                                      int input_px, std::uint64_t seed);

/// Whether the name of a parameter or module lies in one of the frozen layers. "backbone" are
/// the layers before the first that joins two levels.
[[nodiscard]] bool is_frozen(const std::string& name, const std::vector<std::string>& frozen);

/// Stops the derivatives of frozen layers.
/// @throws core::InputError naming an entry that no parameter has.
void freeze_layers(torch::nn::Module& module, const std::vector<std::string>& frozen);

/// Training mode, but for the batch norms of frozen layers, or all under kFrozen.
void enter_training_mode(torch::nn::Module& module, const std::vector<std::string>& frozen,
                         NormPolicy policy);

/// Weight of the newest batch in the running statistics of all batch norms, (0, 1].
void set_norm_momentum(torch::nn::Module& module, double momentum);

/// How decay and warm-up treat a parameter. Decay acts on weights only: neither on biases nor
/// on batch norms.
struct ParameterGroup {
  bool decays, is_bias;
  double rate_factor;  ///< 1, or that of the class layer's rows.
  std::vector<torch::Tensor> parameters;
};
/// Of the parameters that are trained. Always the same groups, of which some may be empty:
/// weights, weights of batch norms, biases, weights and biases of the class layer.
[[nodiscard]] std::vector<ParameterGroup> group_parameters(const torch::nn::Module& module,
                                                           double class_rate);

}  // namespace segsim::perception
