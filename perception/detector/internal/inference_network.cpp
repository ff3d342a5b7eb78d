#include "perception/detector/internal/inference_network.h"

#include "perception/checkpoint/yolov13_scale.h"
#include "perception/internal/centernet/network.h"
#include "perception/internal/yolov13/network.h"

namespace segsim::perception {
namespace {

template <class Network>
InferenceNetwork prepare(Network network, const DetectorWeights& weights,
                         const std::string& place, const torch::Device& device) {
  import_tensors(*network, weights.tensors, place);
  network->to(device);
  network->prepare_for_inference();
  return [network](const torch::Tensor& x) mutable -> NetworkOutput {
    return network->forward(x);
  };
}

}  // namespace

InferenceNetwork make_inference_network(const DetectorWeights& weights,
                                        const std::string& place,
                                        const torch::Device& device) {
  const int class_count = static_cast<int>(weights.class_names.size());
  if (weights.architecture == DetectorWeights::kCenterNet) {
    return prepare(centernet::Network(class_count), weights, place, device);
  }
  if (!yolov13::is_architecture(weights.architecture)) {
    return prepare(TinyDetector(weights.width, class_count, weights.input_px), weights, place,
                   device);
  }
  const auto scale = yolov13::scale_of_architecture(weights.architecture, place);
  return prepare(yolov13::Network(scale, class_count), weights, place, device);
}

}  // namespace segsim::perception
