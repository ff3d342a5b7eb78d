#include "perception/detector/detector.h"

#include <ATen/Parallel.h>

#include <atomic>
#include <mutex>
#include <opencv2/core/utility.hpp>

#include "core/check.h"
#include "core/error.h"
#include "perception/checkpoint/weights_file.h"
#include "perception/data/letterbox.h"
#include "perception/data/nms.h"
#include "perception/detector/device_frame_tensors.h"
#include "perception/detector/internal/frame_stream.h"
#include "perception/detector/internal/inference.h"
#include "perception/internal/network/thread_count.h"
#include "perception/internal/network/torch_device.h"

namespace segsim::perception {
namespace {

std::atomic<int> wanted_threads{1};
thread_local int own_threads = 0;  ///< Of a ThreadCountScope; 0: the process's.

/// OpenCV has one count for the process, and may not change it while another thread is at
/// work.
void apply_to_opencv() {
  static std::mutex mutex;
  static int applied = 0;
  const std::lock_guard<std::mutex> lock(mutex);
  const int wanted = wanted_threads;
  if (applied == wanted) return;
  cv::setNumThreads(wanted);
  applied = wanted;
}

/// OpenBLAS has one count for the process, too: a thread with another one changes it at its
/// next large product, and frees buffers, which no two threads may do at once. So every thread
/// takes its count there before it does anything else.
void apply_to_blas() {
  constexpr std::int64_t kLarge = 128;  // Smaller products never ask for the count.
  static std::mutex mutex;
  const std::lock_guard<std::mutex> lock(mutex);
  const torch::NoGradGuard no_grad;
  const torch::Tensor ones = torch::ones({kLarge, kLarge});
  (void)torch::mm(ones, ones);
}

class LearnedDetector final : public BatchDetector {
 public:
  LearnedDetector(const DetectorWeights& weights, const std::string& place,
                  const DetectorOptions& options)
      : options_(options),
        input_px_(weights.input_px),
        score_threshold_(options.score_threshold.value_or(weights.score_threshold)),
        class_names_(weights.class_names),
        device_(torch_device(options.device, "detector: device")),
        inference_(make_inference_network(weights, place, device_), weights.input_px, device_,
                   options.mixed_precision) {}

  [[nodiscard]] const std::vector<std::string>& class_names() const override {
    return class_names_;
  }

  [[nodiscard]] std::vector<core::Detection> detect(
      const core::Observation& observation) override {
    const core::Image<core::Rgb8>* const images[] = {observation.rgb};
    return std::move(detect_batch(images)[0]);
  }

  [[nodiscard]] std::vector<std::vector<core::Detection>> detect_batch(
      std::span<const core::Image<core::Rgb8>* const> images) override {
    if (images.empty()) return {};
    apply_thread_count();
    std::vector<Letterbox> fits;
    std::vector<core::Image<core::Rgb8>> squares;
    for (const auto* image : images) {
      SEGSIM_CHECK(image != nullptr && !image->empty(), "no image");
      fits.push_back(Letterbox::fit(image->width_px(), image->height_px(), input_px_));
      squares.push_back(letterbox(*image, fits.back()));
    }
    return finish(inference_.candidates(inference_.upload(squares), score_threshold_), fits);
  }

  [[nodiscard]] std::vector<std::vector<core::Detection>> detect_frames(
      const core::DeviceFrames& frames) override {
    const bool on_host = frames.device == core::kHostDevice;
    if (on_host != device_.is_cpu()) {
      throw core::InputError::expected("detector: images",
                                       device_.is_cpu() ? "in the host's memory" : "on a GPU",
                                       on_host ? "in the host's memory" : "on a GPU");
    }
    apply_thread_count();
    const FrameStreamScope stream(frames);
    const Letterbox fit = Letterbox::fit(frames.width_px, frames.height_px, input_px_);
    const auto input =
        inference_.letterbox_on_device(image_tensor(frames, DeviceImage::kRgb), fit);
    return finish(inference_.candidates(input, score_threshold_),
                  std::vector<Letterbox>(static_cast<std::size_t>(frames.count), fit));
  }

 private:
  [[nodiscard]] std::vector<std::vector<core::Detection>> finish(
      const std::vector<Candidates>& candidates, const std::vector<Letterbox>& fits) const {
    std::vector<std::vector<core::Detection>> found;
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      found.push_back(
          suppress_overlaps(candidates[i], options_.nms_iou, options_.max_detections));
      for (core::Detection& detection : found.back()) {
        detection.box = fits[i].to_image(detection.box);
      }
    }
    return found;
  }

  DetectorOptions options_;
  int input_px_;
  float score_threshold_;
  std::vector<std::string> class_names_;
  torch::Device device_;
  Inference inference_;
};

}  // namespace

void set_threads(int count) {
  SEGSIM_CHECK(count >= 1, std::to_string(count));
  wanted_threads = count;
  apply_thread_count();
}

int threads() { return own_threads > 0 ? own_threads : wanted_threads.load(); }

void apply_thread_count() {
  thread_local int applied = 0;
  const int wanted = threads();
  if (applied == wanted) return;
  // A thread's first question makes libtorch give it the count that some thread set last;
  // asked later, that would undo what is set here.
  (void)at::get_num_threads();
  at::set_num_threads(wanted);
  apply_to_opencv();
  apply_to_blas();
  applied = wanted;
}

ThreadCountScope::ThreadCountScope(int count) : before_(own_threads) {
  SEGSIM_CHECK(count >= 1, std::to_string(count));
  own_threads = count;
  apply_thread_count();
}

ThreadCountScope::~ThreadCountScope() {
  own_threads = before_;
  apply_thread_count();
}

std::unique_ptr<BatchDetector> load_detector(const std::filesystem::path& weights,
                                             const DetectorOptions& options) {
  SEGSIM_CHECK(options.max_detections >= 0 && options.nms_iou >= 0.0F, "detector options");
  if (options.mixed_precision && options.device == ComputeDevice::kCpu) {
    throw core::InputError::expected("detector: mixed precision", "device cuda", "cpu");
  }
  return std::make_unique<LearnedDetector>(read_weights(weights), weights.string(), options);
}

}  // namespace segsim::perception
