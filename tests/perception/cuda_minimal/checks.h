#pragma once

/// @file
/// The parts of detector_check (detector_check.cpp). A case prints one line and counts as
/// failed if a number is above its limit, or none.

#include <torch/torch.h>

#include <functional>
#include <string>
#include <vector>

#include "perception/checkpoint/weights_file.h"
#include "perception/checkpoint/yolov13_scale.h"
#include "perception/data/compute_device.h"
#include "perception/data/labeled_box.h"
#include "perception/detector/internal/inference.h"

namespace segsim::perception::checks {

// Tools.
void expect_below(const std::string& what, double value, double limit);
[[nodiscard]] int failures();
[[nodiscard]] double largest_difference(const torch::Tensor& a, const torch::Tensor& b);
/// Of two lists of candidates in pixels, scores times 100; 1e9 if they are of other classes.
[[nodiscard]] double worst_difference(const Candidates& a, const Candidates& b);
/// The score that so many pairs of the output reach.
[[nodiscard]] float score_of_rank(const RawOutput& output, int64_t rank);
/// Of a network with anchors.
[[nodiscard]] RawOutput to_cpu(const NetworkOutput& output);
[[nodiscard]] double median_ms(const torch::Device& device, int rounds,
                               const std::function<void()>& work);

// Inputs.
/// Weights under which all layers matter: statistics and gates moved from where they start.
[[nodiscard]] DetectorWeights lively_weights(const std::string& architecture, int classes,
                                             int input_px);
[[nodiscard]] DetectorWeights lively_yolo(yolov13::Scale scale, int input_px);
[[nodiscard]] torch::Tensor noise(int batch, int side_px);
[[nodiscard]] std::vector<std::vector<LabeledBox>> some_truth(int batch, int classes,
                                                              int side_px);

// Checks: of networks prepared for inference, of the loss and of decoding on a device ...
void check_forward(const std::string& name, const DetectorWeights& weights, int batch,
                   const torch::Device& device);
void check_loss(const std::string& name, const DetectorWeights& weights,
                const torch::Device& device);
void check_decoding(const DetectorWeights& weights, const torch::Device& device);
/// ... of CenterNet, whose output is of another kind, as a whole, ...
void check_heat_maps(const DetectorWeights& weights, const torch::Device& device);
/// ... of steps of training, ...
void check_steps(const std::string& name, const DetectorWeights& weights,
                 ComputeDevice device);
/// ... and of the renderer's pictures where they lie; only with its CUDA part.
void check_shared_stream(const DetectorWeights& weights, const torch::Device& device);

// Times.
void time_inference(const std::string& name, const DetectorWeights& weights,
                    const torch::Device& device);
void time_training(const std::string& name, const DetectorWeights& weights, int batch);

}  // namespace segsim::perception::checks
