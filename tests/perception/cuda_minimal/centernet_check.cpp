#include "checks.h"
#include "perception/internal/centernet/decode.h"
#include "perception/internal/centernet/loss.h"
#include "perception/training/internal/trainable_network.h"

namespace segsim::perception::checks {
namespace {

HeatMaps maps_on(const torch::Device& device, const HeatMaps& maps) {
  return {maps.classes.detach().to(device, torch::kFloat32).clone(),
          maps.sides_px.detach().to(device, torch::kFloat32).clone()};
}

/// Gradients of the loss by classes and sides.
std::pair<torch::Tensor, torch::Tensor> gradients(
    const HeatMaps& maps, const std::vector<std::vector<LabeledBox>>& truth) {
  maps.classes.requires_grad_(true);
  maps.sides_px.requires_grad_(true);
  const auto parts = centernet::heat_loss(maps, truth);
  (parts.classes + parts.box).backward();
  return {maps.classes.grad(), maps.sides_px.grad()};
}

}  // namespace

// Prepared for inference on the device against the plain layers on the CPU; then peaks and
// loss of equal maps on both.
void check_heat_maps(const DetectorWeights& weights, const torch::Device& device) {
  const int classes = static_cast<int>(weights.class_names.size());
  HeatMaps wanted;
  {
    const torch::NoGradGuard no_grad;
    auto plain = make_trainable_network(weights.architecture, weights.width, classes,
                                        weights.input_px, 1);
    import_tensors(*plain.module, weights.tensors, "centernet");
    plain.module->eval();
    const auto on_device = make_inference_network(weights, "centernet", device);
    const auto input = noise(2, weights.input_px);
    wanted = std::get<HeatMaps>(plain.forward(input));
    const auto found = maps_on(torch::kCPU, std::get<HeatMaps>(on_device(input.to(device))));
    expect_below("centernet forward, sides [px]",
                 largest_difference(found.sides_px, wanted.sides_px), 1e-3);
    expect_below("centernet forward, scores",
                 largest_difference(found.classes.sigmoid(), wanted.classes.sigmoid()), 1e-5);
    // Maps with many peaks, which no two cells share.
    torch::manual_seed(9);
    wanted.classes = torch::randn(wanted.classes.sizes()) * 2.0;
    wanted.sides_px = torch::rand(wanted.sides_px.sizes()) * 40.0 + 5.0;
    const auto host = centernet::peaks_on_host(wanted, 0.6F);
    const auto other = centernet::peaks_on_device(maps_on(device, wanted), 0.6F);
    for (std::size_t i = 0; i < host.size(); ++i) {
      expect_below("centernet, " + std::to_string(host[i].size()) + " peaks, boxes [px]",
                   worst_difference(host[i], other[i]), 1e-3);
    }
  }
  const auto truth = some_truth(2, classes, weights.input_px);
  const auto cpu = gradients(maps_on(torch::kCPU, wanted), truth);
  const auto other = gradients(maps_on(device, wanted), truth);
  expect_below("centernet loss, gradient of the classes",
               largest_difference(cpu.first, other.first), 1e-5);
  expect_below("centernet loss, gradient of the sides",
               largest_difference(cpu.second, other.second), 1e-5);
}

}  // namespace segsim::perception::checks
