#include "perception/internal/centernet/network.h"

#include <cmath>
#include <string>

#include "perception/internal/network/network.h"

namespace segsim::perception::centernet {
namespace {

constexpr auto kRelu = Activation::kRelu, kHard = Activation::kHardSwish;

/// Kernel, stride, expanded, out, squeezed.
constexpr BlockForm kBlocks[kBlockCount] = {
    {3, 1, 0, 16, 0, kRelu},      {3, 2, 64, 24, 0, kRelu},     {3, 1, 72, 24, 0, kRelu},
    {5, 2, 72, 32, 24, kRelu},    {5, 1, 96, 32, 24, kRelu},    {5, 1, 96, 32, 24, kRelu},
    {3, 2, 192, 64, 0, kHard},    {3, 1, 160, 64, 0, kHard},    {3, 1, 144, 64, 0, kHard},
    {3, 1, 144, 64, 0, kHard},    {3, 1, 384, 88, 96, kHard},   {3, 1, 528, 88, 136, kHard},
    {5, 2, 528, 120, 136, kHard}, {5, 1, 720, 120, 184, kHard}, {5, 1, 720, 120, 184, kHard}};
/// Whose expanded maps (2, 3) or results (4) go to the pyramid.
constexpr std::size_t kBlockOfC2 = 3, kBlockOfC3 = 5, kBlockOfC4 = 11;

/// The last layers learn multiples of this many pixels.
constexpr double kSideUnit_px = 16.0;

}  // namespace

NetworkImpl::NetworkImpl(int class_count) {
  stem_ = register_module("stem", Conv(3, 16, 3, kHard, 2));
  auto list = register_module("blocks", torch::nn::ModuleList());
  int channels = 16;
  for (const BlockForm& form : kBlocks) {
    blocks_.emplace_back(channels, form);
    list->push_back(blocks_.back());
    channels = form.out;
  }
  widen_ = register_module("widen", Conv(channels, 480, 1, kHard));
  merge4_ = register_module("merge4", Merge(88, 22, 480, 128));
  merge3_ = register_module("merge3", Merge(96, 24, 256, 96));
  merge2_ = register_module("merge2", Merge(72, 18, 192, 64));
  gate_ = register_module("gate", Squeeze(128, 32, SqueezeImpl::Gate::kSigmoid));
  class_head_ = register_module("class_head", Separable(128, class_count, 3, "last"));
  box_head_ = register_module("box_head", Separable(128, 4, 3, "last"));
}

HeatMaps NetworkImpl::forward(const torch::Tensor& input) {
  auto x = stem_(input);
  torch::Tensor c2, c3, c4;
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    const auto expanded = blocks_[i]->expand(x);
    x = blocks_[i]->finish(x, expanded);
    if (i == kBlockOfC2) c2 = expanded;
    if (i == kBlockOfC3) c3 = expanded;
    if (i == kBlockOfC4) c4 = x;
  }
  const auto top = gate_(merge2_(c2, merge3_(c3, merge4_(c4, widen_(x)))));
  return {class_head_(top), kSideUnit_px * box_head_(top)};
}

void NetworkImpl::prepare_for_inference() {
  eval();
  for (const auto& module : modules(false)) {
    if (auto* conv = module->as<ConvImpl>()) conv->fold();
  }
}

void NetworkImpl::initialize(std::uint64_t seed) {
  const torch::NoGradGuard no_grad;
  constexpr double kHeadDeviation = 1e-3, kClassLogit = -2.19;  // As published.
  for (const auto& item : named_parameters()) {
    if (item.value().dim() < 2) continue;  // Biases begin at 0.
    const double fan_in = static_cast<double>(item.value()[0].numel());
    const bool last = item.key().find("head.last.") != std::string::npos;
    const double deviation = last ? kHeadDeviation : std::sqrt(2.0 / fan_in);
    fill_uniform(item.value(), std::sqrt(3.0) * deviation, seed, item.key());
  }
  named_parameters()["class_head.last.bias"].fill_(kClassLogit);
}

}  // namespace segsim::perception::centernet
