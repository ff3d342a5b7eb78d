#include "perception/internal/yolov13/network.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/random.h"

namespace segsim::perception::yolov13 {
namespace {

constexpr int kHeadConvs = 3;  // Per level and branch.
constexpr double kObjectsPerImage = 5.0, kReferenceSide_px = 640.0;

std::shared_ptr<Chain> chain(std::vector<std::shared_ptr<Block>> blocks) {
  return std::make_shared<Chain>(std::move(blocks));
}

bool ends_with(const std::string& text, const std::string& end) {
  return text.size() >= end.size() &&
         text.compare(text.size() - end.size(), end.size(), end) == 0;
}

/// Half width of the uniform distribution a parameter starts from; 0 if it keeps the value of
/// its construction.
double start_bound(const std::string& name, const torch::Tensor& value,
                   const torch::OrderedDict<std::string, torch::Tensor>& all) {
  if (ends_with(name, "dfl.conv.weight")) return 0.0;
  if (ends_with(name, "prototype_base")) {
    return std::sqrt(6.0 / static_cast<double>(value.size(0) + value.size(1)));
  }
  const auto bound_of = [](const torch::Tensor& weight) {
    return 1.0 / std::sqrt(static_cast<double>(weight[0].numel()));
  };
  if (value.dim() >= 2) return bound_of(value);
  // Biases of linear layers follow their weights; batch norms and gates stay.
  if (!ends_with(name, ".bias")) return 0.0;
  const auto* weight = all.find(name.substr(0, name.size() - 4) + "weight");
  return weight != nullptr && weight->dim() >= 2 ? bound_of(*weight) : 0.0;
}

}  // namespace

Head::Head(const std::array<int, 3>& inputs, int class_count) : class_count_(class_count) {
  const int box_channels = std::max({16, inputs[0] / 4, 4 * kRegBins});
  const int class_channels = std::max(inputs[0], std::min(class_count, 100));
  const auto depthwise = [](int channels) {
    return std::make_shared<Conv>(channels, channels, 3, 1, channels);
  };
  for (const int in : inputs) {
    box_.push_back(chain({std::make_shared<Conv>(in, box_channels, 3),
                          std::make_shared<Conv>(box_channels, box_channels, 3),
                          std::make_shared<OutputConv>(box_channels, 4 * kRegBins)}));
    classes_.push_back(
        chain({chain({depthwise(in), std::make_shared<Conv>(in, class_channels, 1)}),
               chain({depthwise(class_channels),
                      std::make_shared<Conv>(class_channels, class_channels, 1)}),
               std::make_shared<OutputConv>(class_channels, class_count)}));
  }
  register_list(*this, "cv2", box_);
  register_list(*this, "cv3", classes_);
  auto dfl = register_module("dfl", std::make_shared<torch::nn::Module>());
  auto conv = dfl->register_module("conv", std::make_shared<torch::nn::Module>());
  bins_ = conv->register_parameter(
      "weight", torch::arange(kRegBins, torch::kFloat32).view({1, kRegBins, 1, 1}), false);
}

RawOutput Head::forward(const std::array<torch::Tensor, 3>& maps) {
  std::vector<torch::Tensor> boxes, classes;
  for (std::size_t level = 0; level < maps.size(); ++level) {
    boxes.push_back(rows_of_anchors(box_[level]->forward(maps[level])));
    classes.push_back(rows_of_anchors(classes_[level]->forward(maps[level])));
  }
  return {torch::cat(boxes, 1), torch::cat(classes, 1)};
}

void Head::initialize_biases() {
  const torch::NoGradGuard no_grad;
  const std::string bias = std::to_string(kHeadConvs - 1) + ".bias";
  for (std::size_t level = 0; level < box_.size(); ++level) {
    const double cells = kReferenceSide_px / kStrides[level];
    box_[level]->named_parameters()[bias].fill_(1.0);
    classes_[level]->named_parameters()[bias].fill_(
        std::log(kObjectsPerImage / class_count_ / (cells * cells)));
  }
}

template <class T, class... Arguments>
std::shared_ptr<T> NetworkImpl::layer(int index, Arguments&&... arguments) {
  return layers_->register_module(std::to_string(index),
                                  std::make_shared<T>(std::forward<Arguments>(arguments)...));
}

NetworkImpl::NetworkImpl(Scale scale, int class_count) {
  const ScaleTable& table = table_of(scale);
  const auto ch = [&table](int nominal) { return table.channels(nominal); };
  const int c64 = ch(64), c128 = ch(128), c256 = ch(256), c512 = ch(512), c1024 = ch(1024);
  const int two = table.repeats(2), four = table.repeats(4);
  const bool deep = table.deep_inner;
  layers_ = register_module("model", std::make_shared<torch::nn::Module>());

  conv0_ = layer<Conv>(0, 3, c64, 3, 2);
  conv1_ = layer<Conv>(1, c64, c128, 3, 2, 2);
  csp2_ = layer<DsC3k2>(2, c128, c256, two, deep, 0.25);
  conv3_ = layer<Conv>(3, c256, c256, 3, 2, 4);
  csp4_ = layer<DsC3k2>(4, c256, c512, two, deep, 0.25);
  down5_ = layer<DsConv>(5, c512, c512, 3, 2);
  attention6_ = layer<A2C2f>(6, c512, c512, four, 4, table.mlp_ratio, deep);
  down7_ = layer<DsConv>(7, c512, c1024, 3, 2);
  attention8_ = layer<A2C2f>(8, c1024, c1024, four, 1, table.mlp_ratio, deep);

  hyper9_ = layer<HyperAce>(9, c512, c512, c1024, c512, two, table.hyperedges);
  down11_ = layer<DownsampleConv>(11, c512, c1024);
  tunnel12_ = layer<Tunnel>(12);
  tunnel13_ = layer<Tunnel>(13);
  tunnel14_ = layer<Tunnel>(14);

  csp17_ = layer<DsC3k2>(17, c1024 + c512, c512, two, true);
  tunnel18_ = layer<Tunnel>(18);
  csp21_ = layer<DsC3k2>(21, c512 + c512, c256, two, true);
  conv22_ = layer<Conv>(22, c512, c256, 1);
  tunnel23_ = layer<Tunnel>(23);
  conv24_ = layer<Conv>(24, c256, c256, 3, 2);
  csp26_ = layer<DsC3k2>(26, c256 + c512, c512, two, true);
  tunnel27_ = layer<Tunnel>(27);
  conv28_ = layer<Conv>(28, c512, c512, 3, 2);
  csp30_ = layer<DsC3k2>(30, c512 + c1024, c1024, two, true);
  tunnel31_ = layer<Tunnel>(31);
  head_ = layer<Head>(32, std::array<int, 3>{c256, c512, c1024}, class_count);
}

const torch::Tensor& NetworkImpl::keep(std::size_t index, const torch::Tensor& map) {
  if (keep_maps_) maps_[index] = map;
  return map;
}

RawOutput NetworkImpl::forward(const torch::Tensor& x) {
  const auto p2 =
      keep(2, csp2_->forward(keep(1, conv1_->forward(keep(0, conv0_->forward(x))))));
  const auto p3 = keep(4, csp4_->forward(keep(3, conv3_->forward(p2))));
  const auto p4 = keep(6, attention6_->forward(keep(5, down5_->forward(p3))));
  const auto p5 = keep(8, attention8_->forward(keep(7, down7_->forward(p4))));

  // The correlations, at the three sizes, into the backbone's maps.
  const auto middle = keep(9, hyper9_->forward(p3, p4, p5));
  const auto fine = keep(10, upsample2(middle)), coarse = keep(11, down11_->forward(middle));
  const auto t4 = keep(12, tunnel12_->forward(p4, middle));
  const auto t3 = keep(13, tunnel13_->forward(p3, fine));
  const auto t5 = keep(14, tunnel14_->forward(p5, coarse));

  // Down the pyramid and up again; the untunnelled maps go on, the tunnelled ones aside.
  const auto n4 = keep(17, csp17_->forward(keep(16, torch::cat({upsample2(t5), t4}, 1))));
  const auto n4_t = keep(18, tunnel18_->forward(n4, middle));
  const auto n3 = keep(21, csp21_->forward(keep(20, torch::cat({upsample2(n4), t3}, 1))));
  const auto out3 = keep(23, tunnel23_->forward(n3, keep(22, conv22_->forward(fine))));
  const auto m4 = keep(
      26, csp26_->forward(keep(25, torch::cat({keep(24, conv24_->forward(out3)), n4_t}, 1))));
  const auto out4 = keep(27, tunnel27_->forward(m4, middle));
  const auto m5 =
      keep(30, csp30_->forward(keep(29, torch::cat({keep(28, conv28_->forward(m4)), t5}, 1))));
  const auto out5 = keep(31, tunnel31_->forward(m5, coarse));
  return head_->forward({out3, out4, out5});
}

void NetworkImpl::prepare_for_inference() {
  eval();
  for (const auto& module : modules(false)) {
    if (auto* block = dynamic_cast<FoldingBlock*>(module.get())) block->fold();
  }
}

void NetworkImpl::initialize(std::uint64_t seed) {
  const torch::NoGradGuard no_grad;
  const auto all = named_parameters();
  for (const auto& item : all) {
    const double bound = start_bound(item.key(), item.value(), all);
    if (bound > 0.0) fill_uniform(item.value(), bound, seed, item.key());
  }
  head_->initialize_biases();
}

void NetworkImpl::seed_dropout(std::uint64_t seed) {
  for (const auto& item : named_modules()) {
    if (auto* generator = item.value()->as<HyperedgeGenerator>()) {
      generator->seed_dropout(core::hash64(item.key(), seed));
    }
  }
}

}  // namespace segsim::perception::yolov13
