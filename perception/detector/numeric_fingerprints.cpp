#include "perception/detector/numeric_fingerprints.h"

#include <torch/torch.h>

#include <cstdint>
#include <cstring>
#include <opencv2/imgproc.hpp>
#include <span>
#include <vector>

#include "core/file_io.h"
#include "perception/detector/detector.h"
#include "perception/internal/network/network.h"

namespace segsim::perception {
namespace {

/// Uniform in [-1, 1), from our own random numbers.
torch::Tensor values(const std::vector<std::int64_t>& shape, const std::string& name) {
  torch::Tensor tensor = torch::empty(shape);
  fill_uniform(tensor, 1.0, 1, name);
  return tensor;
}

std::string sha256_of(const std::vector<torch::Tensor>& tensors) {
  std::string text;
  for (const torch::Tensor& tensor : tensors) {
    const torch::Tensor dense = tensor.detach().contiguous();
    text += core::sha256_hex(std::as_bytes(
        std::span(dense.data_ptr<float>(), static_cast<std::size_t>(dense.numel()))));
  }
  return core::sha256_hex(text);
}

std::string convolution_fingerprint(bool with_gradients) {
  torch::Tensor x = values({4, 24, 32, 32}, "x"), weight = values({32, 24, 3, 3}, "weight");
  torch::Tensor small = values({32, 32, 1, 1}, "small");
  const torch::AutoGradMode mode(with_gradients);
  for (torch::Tensor* tensor : {&x, &weight, &small}) tensor->requires_grad_(with_gradients);
  const torch::Tensor y = torch::conv2d(torch::conv2d(x, weight, {}, 2, 1), small);
  if (!with_gradients) return sha256_of({y});
  y.square().sum().backward();
  return sha256_of({x.grad(), weight.grad(), small.grad()});
}

std::string opencv_fingerprint() {
  cv::Mat picture(90, 120, CV_8UC3);
  for (int i = 0; i < picture.rows * picture.cols * 3; ++i) {
    picture.data[i] = static_cast<std::uint8_t>((i * 2654435761U) >> 24U);
  }
  cv::Mat whole, scaled, warped;
  picture.convertTo(whole, CV_32FC3, 1.0 / 255.0);
  cv::resize(whole, scaled, {77, 61}, 0, 0, cv::INTER_LINEAR);
  cv::warpAffine(whole, warped, cv::getRotationMatrix2D({60.0F, 45.0F}, 20.0, 1.1),
                 whole.size());
  std::string text;
  for (const cv::Mat& mat : {scaled, warped}) {
    text += core::sha256_hex(std::as_bytes(std::span(mat.data, mat.total() * mat.elemSize())));
  }
  return core::sha256_hex(text);
}

}  // namespace

std::map<std::string, std::string> numeric_fingerprints() {
  const int before = threads();
  set_threads(1);
  const torch::NoGradGuard no_gradients;
  const torch::Tensor x = values({64, 257}, "x"), y = values({257, 96}, "y");
  std::map<std::string, std::string> found;
  found["elementary functions (libtorch)"] = sha256_of(
      {torch::exp(x), torch::sigmoid(x), torch::softmax(x, 1), torch::rsqrt(x.abs() + 0.1),
       torch::tanh(x), torch::log1p(x.abs()), torch::silu(x)});
  found["sums (libtorch)"] = sha256_of({x.sum({1}), x.sum(), x.mean({0}), x.var({1})});
  found["matrix product (BLAS)"] = sha256_of({torch::matmul(x, y)});
  found["convolution (oneDNN)"] = convolution_fingerprint(false);
  found["gradients of convolutions (oneDNN)"] = convolution_fingerprint(true);
  found["resizing and warping (OpenCV)"] = opencv_fingerprint();
  set_threads(before);
  return found;
}

}  // namespace segsim::perception
