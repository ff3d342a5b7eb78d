#include "perception/detector.h"

#include <ATen/Parallel.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <opencv2/core/utility.hpp>

#include "core/error.h"
#include "perception/internal/inference_network.h"
#include "perception/internal/thread_count.h"
#include "perception/letterbox.h"
#include "perception/nms.h"

namespace segsim::perception {
namespace {

std::atomic<int> wanted_threads{1};

/// Expectation of the softmax over one side's bins, in strides.
float expected_distance(const float* logits) {
  const float top = *std::max_element(logits, logits + kRegBins);
  float sum = 0.0F, moment = 0.0F;
  for (int bin = 0; bin < kRegBins; ++bin) {
    const float p = std::exp(logits[bin] - top);
    sum += p;
    moment += p * static_cast<float>(bin);
  }
  return moment / sum;
}

class LearnedDetector final : public core::Detector {
 public:
  LearnedDetector(const std::filesystem::path& file, const DetectorOptions& options)
      : options_(options) {
    DetectorWeights weights = read_weights(file);
    input_px_ = weights.input_px;
    score_threshold_ = options.score_threshold.value_or(weights.score_threshold);
    network_ = make_inference_network(weights, file.string());
    class_names_ = std::move(weights.class_names);
    const Anchors anchors = make_anchors(input_px_, torch::kFloat32);
    const float* centres = anchors.centre_px.data_ptr<float>();
    const float* strides = anchors.stride_px.data_ptr<float>();
    for (int64_t a = 0; a < anchors.stride_px.numel(); ++a) {
      anchors_.push_back({centres[2 * a], centres[2 * a + 1], strides[a]});
    }
  }

  [[nodiscard]] const std::vector<std::string>& class_names() const override {
    return class_names_;
  }

  [[nodiscard]] std::vector<core::Detection> detect(
      const core::Observation& observation) override {
    SEGSIM_CHECK(observation.rgb != nullptr && !observation.rgb->empty(), "no image");
    const auto& image = *observation.rgb;
    const Letterbox fit = Letterbox::fit(image.width_px(), image.height_px(), input_px_);
    std::vector<core::Detection> found = suppress_overlaps(
        candidates(letterbox(image, fit)), options_.nms_iou, options_.max_detections);
    for (core::Detection& detection : found) detection.box = fit.to_image(detection.box);
    return found;
  }

 private:
  struct Anchor {
    float x_px, y_px, stride_px;
  };

  /// All (anchor, class) pairs that reach the threshold, in pixels of the square.
  [[nodiscard]] std::vector<core::Detection> candidates(
      const core::Image<core::Rgb8>& square) {
    apply_thread_count();
    const torch::InferenceMode inference;
    const RawOutput output = network_(to_tensor(square));
    const auto box = output.box.contiguous(), classes = output.classes.contiguous();
    const float* box_logits = box.data_ptr<float>();
    const float* class_logits = classes.data_ptr<float>();
    const std::size_t class_count = class_names_.size();
    std::vector<core::Detection> found;
    for (std::size_t a = 0; a < anchors_.size(); ++a) {
      bool decoded = false;
      core::BoxPx corners;
      for (std::size_t c = 0; c < class_count; ++c) {
        const float score = 1.0F / (1.0F + std::exp(-class_logits[a * class_count + c]));
        if (!(score >= score_threshold_)) continue;
        if (!decoded) corners = decode(anchors_[a], box_logits + a * 4 * kRegBins);
        decoded = true;
        found.push_back({static_cast<int>(c), score, corners});
      }
    }
    return found;
  }

  [[nodiscard]] static core::BoxPx decode(const Anchor& anchor, const float* logits) {
    const auto side = [&](int i) {
      return expected_distance(logits + i * kRegBins) * anchor.stride_px;
    };
    return {anchor.x_px - side(0), anchor.y_px - side(1), anchor.x_px + side(2),
            anchor.y_px + side(3)};
  }

  /// [1, 3, size, size], RGB in [0, 1].
  [[nodiscard]] static torch::Tensor to_tensor(const core::Image<core::Rgb8>& square) {
    auto tensor = torch::empty({1, 3, square.height_px(), square.width_px()}, torch::kFloat32);
    const std::size_t count = square.size();
    float* out = tensor.data_ptr<float>();
    for (std::size_t i = 0; i < count; ++i) {
      const core::Rgb8 pixel = square.data()[i];
      out[i] = static_cast<float>(pixel.r) / 255.0F;
      out[count + i] = static_cast<float>(pixel.g) / 255.0F;
      out[2 * count + i] = static_cast<float>(pixel.b) / 255.0F;
    }
    return tensor;
  }

  DetectorOptions options_;
  std::vector<std::string> class_names_;
  int input_px_ = 0;
  float score_threshold_ = 0.0F;
  InferenceNetwork network_;
  std::vector<Anchor> anchors_;
};

}  // namespace

void set_threads(int count) {
  SEGSIM_CHECK(count >= 1, std::to_string(count));
  wanted_threads = count;
  apply_thread_count();
}

int threads() { return wanted_threads; }

void apply_thread_count() {
  thread_local int applied = 0;
  const int wanted = wanted_threads;
  if (applied == wanted) return;
  at::set_num_threads(wanted);
  cv::setNumThreads(wanted);
  applied = wanted;
}

std::unique_ptr<core::Detector> load_detector(const std::filesystem::path& weights,
                                              const DetectorOptions& options) {
  SEGSIM_CHECK(options.max_detections >= 0 && options.nms_iou >= 0.0F, "detector options");
  return std::make_unique<LearnedDetector>(weights, options);
}

}  // namespace segsim::perception
