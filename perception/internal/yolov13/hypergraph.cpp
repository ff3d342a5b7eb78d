#include "perception/internal/yolov13/hypergraph.h"

#include <ATen/CPUGeneratorImpl.h>

#include <cmath>

#include "core/check.h"
#include "perception/internal/network/network.h"

namespace segsim::perception::yolov13 {
namespace {

constexpr double kDropout = 0.1;

torch::Tensor run_linear(torch::nn::Linear& layer, const torch::Tensor& x) {
  auto y = layer(x);
  MacCounter::add(y.numel() * layer->weight.size(1));
  return y;
}

/// The same for many tokens [batch, tokens, channels]: once folded by oneDNN, for which they
/// are a map with its channels innermost (onednn.h says why not by the BLAS library).
torch::Tensor run_linear(torch::nn::Linear& layer, FoldedConvolution& folded,
                         const torch::Tensor& tokens) {
  if (folded.empty()) return run_linear(layer, tokens);
  const auto y = folded.run(tokens.transpose(1, 2).unsqueeze(3));
  MacCounter::add(y.numel() * folded.macs_per_value());
  return y.squeeze(3).transpose(1, 2);
}

FoldedConvolution fold_linear(const torch::nn::Linear& layer) {
  return {layer->weight.unsqueeze(2).unsqueeze(3), layer->bias, {}};
}

/// x Phi(x), exact. Training writes it out: the derivative of libtorch 1.13's own GELU, in
/// float on the CPU, is memory that nobody has written wherever the incoming one is laid out
/// in another order (here: always, tokens are columns of the map), at times a NaN.
torch::Tensor exact_gelu(const torch::Tensor& x) {
  if (!torch::GradMode::is_enabled()) return torch::gelu(x);
  return 0.5 * x * (1.0 + torch::erf(x * std::sqrt(0.5)));
}

/// A module that only gives its child a name, as lists and containers of the state dict do.
template <class Child>
std::shared_ptr<torch::nn::Module> named(const std::string& name, Child child) {
  auto holder = std::make_shared<torch::nn::Module>();
  holder->register_module(name, child);
  return holder;
}

}  // namespace

HyperedgeGenerator::HyperedgeGenerator(int channels, int hyperedges)
    : channels_(channels),
      hyperedges_(hyperedges),
      dropout_(at::detail::createCPUGenerator()) {
  prototypes_ = register_parameter("prototype_base", torch::zeros({hyperedges, channels}));
  context_ =
      register_module("context_net", torch::nn::Linear(2 * channels, hyperedges * channels));
  projection_ = register_module("pre_head_proj", torch::nn::Linear(channels, channels));
}

torch::Tensor HyperedgeGenerator::forward(const torch::Tensor& tokens) {
  const auto context = torch::cat({tokens.mean(1), tokens.amax(1)}, 1);
  const auto prototypes =
      prototypes_ + run_linear(context_, context).view({-1, hyperedges_, channels_});
  // The mean over heads of products of 16 channels is one product of all channels, divided by
  // the number of heads.
  const double heads = static_cast<double>(channels_) / kHyperHeadChannels;
  const auto logits = torch::bmm(run_linear(projection_, folded_projection_, tokens),
                                 prototypes.transpose(1, 2)) /
                      (heads * std::sqrt(double{kHyperHeadChannels}));
  return (is_training() ? drop_out(logits) : logits).softmax(1);
}

/// torch::dropout draws from the process's one generator, which whatever else is built or
/// trained in the process moves meanwhile.
torch::Tensor HyperedgeGenerator::drop_out(const torch::Tensor& logits) {
  const auto kept = torch::empty(logits.sizes()).bernoulli_(1.0 - kDropout, dropout_);
  return logits * (kept / (1.0 - kDropout)).to(logits.options());
}

void HyperedgeGenerator::seed_dropout(std::uint64_t seed) { dropout_.set_current_seed(seed); }

void HyperedgeGenerator::fold() { folded_projection_ = fold_linear(projection_); }

HypergraphConv::HypergraphConv(int channels, int hyperedges) {
  generator_ = register_module("edge_generator",
                               std::make_shared<HyperedgeGenerator>(channels, hyperedges));
  edge_ = torch::nn::Linear(channels, channels);
  node_ = torch::nn::Linear(channels, channels);
  register_module("edge_proj", named("0", edge_));
  register_module("node_proj", named("0", node_));
}

torch::Tensor HypergraphConv::forward(const torch::Tensor& tokens) {
  const auto participation = generator_->forward(tokens);
  const auto edges =
      exact_gelu(run_linear(edge_, torch::bmm(participation.transpose(1, 2), tokens)));
  return exact_gelu(run_linear(node_, folded_node_, torch::bmm(participation, edges))) +
         tokens;
}

void HypergraphConv::fold() {
  generator_->fold();
  folded_node_ = fold_linear(node_);
}

C3AH::C3AH(int channels, int hyperedges) {
  SEGSIM_CHECK(channels % kHyperHeadChannels == 0, std::to_string(channels));
  cv1_ = register_module("cv1", std::make_shared<Conv>(channels, channels, 1));
  cv2_ = register_module("cv2", std::make_shared<Conv>(channels, channels, 1));
  hypergraph_ = std::make_shared<HypergraphConv>(channels, hyperedges);
  register_module("m", named("hgnn", hypergraph_));
  cv3_ = register_module("cv3", std::make_shared<Conv>(2 * channels, channels, 1));
}

torch::Tensor C3AH::forward(const torch::Tensor& x) {
  const auto map = cv1_->forward(x);
  const auto tokens = hypergraph_->forward(map.flatten(2).transpose(1, 2).contiguous());
  const auto deep = tokens.transpose(1, 2).reshape(map.sizes());
  return cv3_->forward(torch::cat({deep, cv2_->forward(x)}, 1));
}

HyperAce::HyperAce(int c3, int c4, int c5, int out, int repeats, int hyperedges) {
  const int channels = out / 2;
  cv1_ = register_module("cv1", std::make_shared<Conv>(c4, 3 * channels, 1));
  cv2_ = register_module("cv2", std::make_shared<Conv>((4 + repeats) * channels, out, 1));
  for (int i = 0; i < repeats; ++i) {
    chain_.push_back(std::make_shared<DsC3k>(channels, channels / 2));
  }
  register_list(*this, "m", chain_);
  fuse_ = std::make_shared<Conv>(c3 + c4 + c5, c4, 1);
  register_module("fuse", named("conv_out", fuse_));
  branch1_ = register_module("branch1", std::make_shared<C3AH>(channels, hyperedges));
  branch2_ = register_module("branch2", std::make_shared<C3AH>(channels, hyperedges));
}

torch::Tensor HyperAce::forward(const torch::Tensor& p3, const torch::Tensor& p4,
                                const torch::Tensor& p5) {
  const auto fused =
      fuse_->forward(torch::cat({torch::avg_pool2d(p3, 2), p4, upsample2(p5)}, 1));
  const auto y = cv1_->forward(fused).chunk(3, 1);
  std::vector<torch::Tensor> parts{y[0], branch1_->forward(y[1]), y[2]};
  for (const auto& block : chain_) parts.push_back(block->forward(parts.back()));
  parts.push_back(branch2_->forward(y[1]));
  return cv2_->forward(torch::cat(parts, 1));
}

DownsampleConv::DownsampleConv(int in, int out) {
  if (in != out) {
    adjust_ = register_module("channel_adjust", std::make_shared<Conv>(in, out, 1));
  }
}

torch::Tensor DownsampleConv::forward(const torch::Tensor& x) {
  const auto half = torch::avg_pool2d(x, 2);
  return adjust_ ? adjust_->forward(half) : half;
}

Tunnel::Tunnel() { gate_ = register_parameter("gate", torch::zeros({})); }

torch::Tensor Tunnel::forward(const torch::Tensor& a, const torch::Tensor& b) {
  // In one pass over the maps; autocast would make float32 of both.
  if (runs_on_onednn(a)) return torch::addcmul(a, b, gate_);
  return a + gate_ * b;
}

}  // namespace segsim::perception::yolov13
