#include "perception/internal/network/network.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "core/error.h"
#include "core/random.h"

namespace segsim::perception {
namespace {

int scaled_channels(int channels, double width) {
  return 8 * std::max(1, static_cast<int>(std::ceil(channels * width / 8.0 - 1e-9)));
}

}  // namespace

ConvBlockImpl::ConvBlockImpl(int in, int out, int kernel, int stride) {
  conv_ = register_module("conv", torch::nn::Conv2d(torch::nn::Conv2dOptions(in, out, kernel)
                                                        .stride(stride)
                                                        .padding(kernel / 2)
                                                        .bias(false)));
  norm_ = register_module(
      "norm", torch::nn::BatchNorm2d(
                  torch::nn::BatchNorm2dOptions(out).eps(1e-3).momentum(kNormMomentum)));
}

torch::Tensor ConvBlockImpl::forward(const torch::Tensor& x) {
  if (folded_.empty()) return torch::silu(norm_(conv_(x)));
  return folded_.run(x);
}

void ConvBlockImpl::fold() {
  const auto [weight, bias] = fold_norm(conv_->weight, norm_);
  folded_ =
      FoldedConvolution(weight, bias, {conv_->options.stride()->at(0), 1, Activation::kSilu});
}

CspBlockImpl::CspBlockImpl(int in, int out, bool shortcut) : shortcut_(shortcut) {
  const int half = out / 2;
  split_ = register_module("split", ConvBlock(in, 2 * half, 1));
  first_ = register_module("first", ConvBlock(half, half, 3));
  second_ = register_module("second", ConvBlock(half, half, 3));
  mix_ = register_module("mix", ConvBlock(3 * half, out, 1));
}

torch::Tensor CspBlockImpl::forward(const torch::Tensor& x) {
  const auto both = split_(x);
  const auto right = both.chunk(2, 1)[1];
  auto deep = second_(first_(right));
  if (shortcut_) deep = deep + right;
  return mix_(torch::cat({both, deep}, 1));
}

HeadBranchImpl::HeadBranchImpl(int in, int hidden, int out) {
  first_ = register_module("first", ConvBlock(in, hidden, 3));
  second_ = register_module("second", ConvBlock(hidden, hidden, 3));
  last_ = register_module("last", torch::nn::Conv2d(torch::nn::Conv2dOptions(hidden, out, 1)));
}

torch::Tensor HeadBranchImpl::forward(const torch::Tensor& x) {
  const auto y = second_(first_(x));
  return folded_.empty() ? last_(y) : folded_.run(y);
}

void HeadBranchImpl::fold() { folded_ = FoldedConvolution(last_->weight, last_->bias, {}); }

TinyDetectorImpl::TinyDetectorImpl(double width, int class_count, int input_px)
    : class_count_(class_count), input_px_(input_px) {
  const auto ch = [width](int channels) { return scaled_channels(channels, width); };
  const int c1 = ch(16), c2 = ch(32), c3 = ch(64), c4 = ch(128), c5 = ch(192);
  down1_ = register_module("down1", ConvBlock(3, c1, 3, 2));
  down2_ = register_module("down2", ConvBlock(c1, c2, 3, 2));
  stage2_ = register_module("stage2", CspBlock(c2, c2, true));
  down3_ = register_module("down3", ConvBlock(c2, c3, 3, 2));
  stage3_ = register_module("stage3", CspBlock(c3, c3, true));
  down4_ = register_module("down4", ConvBlock(c3, c4, 3, 2));
  stage4_ = register_module("stage4", CspBlock(c4, c4, true));
  down5_ = register_module("down5", ConvBlock(c4, c5, 3, 2));
  stage5_ = register_module("stage5", CspBlock(c5, c5, true));
  up4_ = register_module("up4", CspBlock(c5 + c4, c4, false));
  up3_ = register_module("up3", CspBlock(c4 + c3, c3, false));
  pan_down3_ = register_module("pan_down3", ConvBlock(c3, c3, 3, 2));
  pan4_ = register_module("pan4", CspBlock(c3 + c4, c4, false));
  pan_down4_ = register_module("pan_down4", ConvBlock(c4, c4, 3, 2));
  pan5_ = register_module("pan5", CspBlock(c4 + c5, c4, false));
  const int inputs[] = {c3, c4, c4};
  for (int level = 0; level < 3; ++level) {
    const std::string number = std::to_string(level);
    box_.emplace_back(
        register_module("box" + number, HeadBranch(inputs[level], ch(48), 4 * kRegBins)));
    class_.emplace_back(
        register_module("class" + number, HeadBranch(inputs[level], ch(48), class_count)));
  }
}

RawOutput TinyDetectorImpl::forward(const torch::Tensor& x) {
  const auto p3 = stage3_(down3_(stage2_(down2_(down1_(x)))));
  const auto p4 = stage4_(down4_(p3));
  const auto p5 = stage5_(down5_(p4));
  const auto t4 = up4_(torch::cat({upsample2(p5), p4}, 1));
  const auto n3 = up3_(torch::cat({upsample2(t4), p3}, 1));
  const auto n4 = pan4_(torch::cat({pan_down3_(n3), t4}, 1));
  const auto n5 = pan5_(torch::cat({pan_down4_(n4), p5}, 1));
  std::vector<torch::Tensor> boxes, classes;
  const torch::Tensor levels[] = {n3, n4, n5};
  for (std::size_t level = 0; level < 3; ++level) {
    boxes.push_back(rows_of_anchors(box_[level](levels[level])));
    classes.push_back(rows_of_anchors(class_[level](levels[level])));
  }
  return {torch::cat(boxes, 1), torch::cat(classes, 1)};
}

void TinyDetectorImpl::prepare_for_inference() {
  eval();
  for (const auto& module : modules(false)) {
    if (auto* block = module->as<ConvBlockImpl>()) block->fold();
    if (auto* branch = module->as<HeadBranchImpl>()) branch->fold();
  }
}

void TinyDetectorImpl::initialize(std::uint64_t seed) {
  torch::NoGradGuard no_grad;
  for (const auto& item : named_parameters()) {
    auto value = item.value();
    if (value.dim() < 2) continue;  // Batch norms start at 1 and 0, as constructed.
    const double bound = 1.0 / std::sqrt(static_cast<double>(value[0].numel()));
    fill_uniform(value, bound, seed, item.key());
  }
  // Every anchor begins with a low score: five objects per 640 px image, spread over all
  // anchors.
  for (std::size_t level = 0; level < 3; ++level) {
    const double cells = static_cast<double>(input_px_) / kStrides[level];
    const double prior = std::log(5.0 / class_count_ / (cells * cells));
    box_[level]->named_parameters()["last.bias"].fill_(1.0);
    class_[level]->named_parameters()["last.bias"].fill_(prior);
  }
}

torch::Tensor rows_of_anchors(const torch::Tensor& map) {
  return map.flatten(2).transpose(1, 2);
}

torch::Tensor upsample2(const torch::Tensor& x) {
  namespace F = torch::nn::functional;
  return F::interpolate(x, F::InterpolateFuncOptions()
                               .size(std::vector<int64_t>{2 * x.size(2), 2 * x.size(3)})
                               .mode(torch::kNearest));
}

std::pair<torch::Tensor, torch::Tensor> fold_norm(const torch::Tensor& weight,
                                                  const torch::nn::BatchNorm2d& norm) {
  const torch::NoGradGuard no_grad;
  const auto gain = norm->weight / torch::sqrt(norm->running_var + norm->options.eps());
  return {(weight * gain.view({-1, 1, 1, 1})).contiguous(),
          (norm->bias - norm->running_mean * gain).contiguous()};
}

void fill_uniform(const torch::Tensor& value, double bound, std::uint64_t seed,
                  const std::string& name) {
  const torch::NoGradGuard no_grad;
  core::RandomStream random(seed, "init/" + name);
  auto numbers = torch::empty(value.sizes(), torch::kFloat32);
  float* out = numbers.data_ptr<float>();
  for (int64_t i = 0; i < numbers.numel(); ++i) {
    out[i] = static_cast<float>(random.uniform(-bound, bound));
  }
  value.copy_(numbers);
}

Anchors make_anchors(int input_px, const torch::TensorOptions& options) {
  return make_anchors(input_px, input_px, options);
}

Anchors make_anchors(int height_px, int width_px, const torch::TensorOptions& options) {
  std::vector<float> centres, strides;
  for (const int stride : kStrides) {
    for (int y = 0; y < height_px / stride; ++y) {
      for (int x = 0; x < width_px / stride; ++x) {
        centres.push_back((static_cast<float>(x) + 0.5F) * static_cast<float>(stride));
        centres.push_back((static_cast<float>(y) + 0.5F) * static_cast<float>(stride));
        strides.push_back(static_cast<float>(stride));
      }
    }
  }
  const auto count = static_cast<int64_t>(strides.size());
  return {torch::tensor(centres).view({count, 2}).to(options.device()),
          torch::tensor(strides).view({count, 1}).to(options.device())};
}

torch::Tensor decode_boxes(const torch::Tensor& box_logits, const Anchors& anchors) {
  auto shape = box_logits.sizes().vec();
  shape.back() = 4;
  shape.push_back(kRegBins);
  const auto bins = torch::arange(kRegBins, box_logits.options());
  const auto distance =
      torch::matmul(box_logits.view(shape).softmax(-1), bins) * anchors.stride_px;
  const auto sides = distance.chunk(2, -1);
  return torch::cat({anchors.centre_px - sides[0], anchors.centre_px + sides[1]}, -1);
}

std::vector<NamedTensor> export_tensors(const torch::nn::Module& module) {
  std::vector<NamedTensor> tensors;
  const auto add = [&tensors](const std::string& name, const torch::Tensor& value) {
    if (!value.is_floating_point()) return;  // num_batches_tracked: not used.
    const auto flat = value.detach().to(torch::kCPU, torch::kFloat32).contiguous();
    const float* data = flat.data_ptr<float>();
    tensors.push_back(
        {name, value.sizes().vec(), std::vector<float>(data, data + flat.numel())});
  };
  for (const auto& item : module.named_parameters()) add(item.key(), item.value());
  for (const auto& item : module.named_buffers()) add(item.key(), item.value());
  return tensors;
}

void import_tensors(torch::nn::Module& module, const std::vector<NamedTensor>& tensors,
                    const std::string& place) {
  const std::string difference = describe_difference(tensors, export_tensors(module));
  if (!difference.empty()) {
    throw core::InputError(place + ": the tensors do not fit the network: " + difference);
  }
  torch::NoGradGuard no_grad;
  auto parameters = module.named_parameters();
  auto buffers = module.named_buffers();
  for (const NamedTensor& tensor : tensors) {
    auto* target = parameters.find(tensor.name);
    if (target == nullptr) target = buffers.find(tensor.name);
    target->copy_(torch::tensor(tensor.values).view(tensor.shape));
  }
}

}  // namespace segsim::perception
