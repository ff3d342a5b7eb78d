#include "reconstruction/labels/internal/query_set.h"

#include <algorithm>
#include <cmath>

#include <ATen/ops/layer_norm.h>

#include "core/check.h"
#include "core/error.h"
#include "core/random.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr std::int64_t kFeatures = core::kInstanceFeatureSize;
constexpr std::int64_t kHidden = 128;
constexpr int kMaxRecordedFrames = 64;  ///< Of a query; enough to compare with min_frames.

Tensor normal(std::int64_t rows, std::int64_t columns, double sigma, std::uint64_t seed,
              const std::string& name, const at::Device& device) {
  core::RandomStream random(seed, name);
  std::vector<float> values(static_cast<std::size_t>(rows * columns));
  for (float& v : values) v = static_cast<float>(sigma * random.normal());
  return device_tensor(values, torch::kFloat32, device).view({rows, columns});
}

Tensor leaf(const AdamTensor& parameter) {
  return parameter.value().detach().requires_grad_(true);
}

Tensor linear(const Tensor& x, const Tensor& weight, const Tensor& bias) {
  return x.matmul(weight.t()) + bias;
}

}  // namespace

Tensor linear_weight(std::int64_t out, std::int64_t in, std::uint64_t seed,
                     const std::string& name, const at::Device& device) {
  core::RandomStream random(seed, name);
  const double bound = 1.0 / std::sqrt(static_cast<double>(in));
  std::vector<float> values(static_cast<std::size_t>(out * in));
  for (float& v : values) v = static_cast<float>(random.uniform(-bound, bound));
  return device_tensor(values, torch::kFloat32, device).view({out, in});
}

QuerySet::QuerySet(const std::vector<QuerySeed>& seeds, int thing_classes,
                   const PanopticTrainingConfig& config, std::uint64_t seed,
                   const at::Device& device)
    : config_(config.query),
      matches_(seeds.size()),
      recent_(seeds.size()),
      frames_(seeds.size()) {
  const auto count = static_cast<std::int64_t>(seeds.size());
  const auto options = torch::TensorOptions().dtype(torch::kFloat32).device(device);
  std::vector<float> position, log_sigma;
  for (const QuerySeed& seed_of_query : seeds) {
    for (int axis = 0; axis < 3; ++axis) {
      position.push_back(seed_of_query.position_m[axis]);
      log_sigma.push_back(std::log(std::clamp(seed_of_query.sigma_m[axis],
                                              static_cast<float>(config_.min_sigma_m),
                                              static_cast<float>(config_.max_sigma_m))));
    }
  }
  position_m_ = AdamTensor(device_tensor(position, torch::kFloat32, device).view({count, 3}));
  log_sigma_ = AdamTensor(device_tensor(log_sigma, torch::kFloat32, device).view({count, 3}));
  Tensor rotation = torch::zeros({count, 4}, options);
  rotation.select(1, 0).fill_(1.0);
  rotation_ = AdamTensor(rotation);
  feature_ = AdamTensor(
      normal(count, kFeatures, config_.feature_noise, seed, "query_feature", device));
  class_feature_ = AdamTensor(torch::zeros({count, kFeatures}, options));
  embed_weight_ =
      AdamTensor(linear_weight(kFeatures, kFeatures, seed, "query_embedding", device));
  embed_bias_ = AdamTensor(torch::zeros({kFeatures}, options));
  norm_weight_ = AdamTensor(torch::ones({kFeatures}, options));
  norm_bias_ = AdamTensor(torch::zeros({kFeatures}, options));
  class_weight1_ = AdamTensor(linear_weight(kHidden, kFeatures, seed, "class_1", device));
  // Class features begin at 0: without a bias no hidden unit would ever have a derivative.
  class_bias1_ =
      AdamTensor(linear_weight(kHidden, kFeatures, seed, "class_bias", device).select(1, 0));
  class_weight2_ =
      AdamTensor(linear_weight(thing_classes + 1, kHidden, seed, "class_2", device));
  class_bias2_ = AdamTensor(torch::zeros({thing_classes + 1}, options));
}

std::vector<std::pair<std::string, AdamTensor*>> QuerySet::parameters() {
  return {{"query.position", &position_m_},
          {"query.log_sigma", &log_sigma_},
          {"query.rotation", &rotation_},
          {"query.feature", &feature_},
          {"query.class_feature", &class_feature_},
          {"embed.weight", &embed_weight_},
          {"embed.bias", &embed_bias_},
          {"norm.weight", &norm_weight_},
          {"norm.bias", &norm_bias_},
          {"class.weight1", &class_weight1_},
          {"class.bias1", &class_bias1_},
          {"class.weight2", &class_weight2_},
          {"class.bias2", &class_bias2_}};
}

QuerySet::Leaves QuerySet::leaves() const {
  return {leaf(position_m_),    leaf(log_sigma_),     leaf(rotation_),    leaf(feature_),
          leaf(class_feature_), leaf(embed_weight_),  leaf(embed_bias_),  leaf(norm_weight_),
          leaf(norm_bias_),     leaf(class_weight1_), leaf(class_bias1_), leaf(class_weight2_),
          leaf(class_bias2_)};
}

void QuerySet::step(const Leaves& leaves, const HeadRateConfig& rate, double rate_factor) {
  const auto apply = [&](AdamTensor& parameter, const Tensor& leaf, double value) {
    if (leaf.grad().defined()) parameter.step(leaf.grad(), value * rate_factor);
  };
  apply(position_m_, leaves.position_m, rate.query_position_m);
  apply(log_sigma_, leaves.log_sigma, rate.query_log_sigma);
  apply(rotation_, leaves.rotation, rate.query_rotation);
  apply(feature_, leaves.feature, rate.query_feature);
  apply(class_feature_, leaves.class_feature, rate.query_class_feature);
  apply(embed_weight_, leaves.embed_weight, rate.class_head);
  apply(embed_bias_, leaves.embed_bias, rate.class_head);
  apply(norm_weight_, leaves.norm_weight, rate.class_head);
  apply(norm_bias_, leaves.norm_bias, rate.class_head);
  apply(class_weight1_, leaves.class_weight1, rate.class_head);
  apply(class_bias1_, leaves.class_bias1, rate.class_head);
  apply(class_weight2_, leaves.class_weight2, rate.class_head);
  apply(class_bias2_, leaves.class_bias2, rate.class_head);
  log_sigma_.clamp(std::log(config_.min_sigma_m), std::log(config_.max_sigma_m));
}

Tensor QuerySet::projected(const Leaves& leaves) {
  return linear(leaves.feature, leaves.embed_weight, leaves.embed_bias);
}

Tensor QuerySet::embedding(const Leaves& leaves, const Tensor& projected) {
  return at::layer_norm(projected, {kFeatures}, leaves.norm_weight, leaves.norm_bias);
}

Tensor QuerySet::class_logits(const Leaves& leaves) {
  const Tensor hidden =
      torch::relu(linear(leaves.class_feature, leaves.class_weight1, leaves.class_bias1));
  return linear(hidden, leaves.class_weight2, leaves.class_bias2);
}

void QuerySet::count_match(std::int64_t query, std::int64_t frame) {
  const auto q = static_cast<std::size_t>(query);
  ++matches_.at(q);
  ++recent_[q];
  if (frames_[q].size() < kMaxRecordedFrames) frames_[q].insert(frame);
}

void QuerySet::keep(const std::vector<std::int64_t>& queries) {
  const Tensor rows = device_tensor(queries, torch::kInt64, position_m_.value().device());
  for (AdamTensor* t : {&position_m_, &log_sigma_, &rotation_, &feature_, &class_feature_}) {
    t->select(rows);
  }
  const auto gather = [&](auto& values) {
    std::remove_reference_t<decltype(values)> kept;
    for (const std::int64_t q : queries)
      kept.push_back(values.at(static_cast<std::size_t>(q)));
    values = std::move(kept);
  };
  gather(matches_);
  gather(recent_);
  gather(frames_);
}

void QuerySet::save(StateWriter& out) const {
  // Not const: the list serves load() too, and save() only reads through it.
  for (const auto& [name, parameter] : const_cast<QuerySet*>(this)->parameters()) {
    parameter->save(out, name);
  }
  out.put_integers("query.matches", matches_);
  out.put_integers("query.recent", recent_);
  std::vector<std::int64_t> frames;
  for (const std::set<std::int64_t>& of_query : frames_) {
    frames.push_back(static_cast<std::int64_t>(of_query.size()));
    frames.insert(frames.end(), of_query.begin(), of_query.end());
  }
  out.put_integers("query.frames", frames);
}

void QuerySet::load(const StateReader& in) {
  for (const auto& [name, parameter] : parameters()) parameter->load(in, name);
  matches_ = in.integers("query.matches");
  recent_ = in.integers("query.recent");
  const auto count = static_cast<std::size_t>(size());
  if (matches_.size() != count || recent_.size() != count) {
    throw core::InputError::expected(in.place(), std::to_string(count) + " counts of matches",
                                     std::to_string(matches_.size()));
  }
  frames_.assign(count, {});
  const std::vector<std::int64_t> frames = in.integers("query.frames");
  std::size_t at = 0;
  for (std::set<std::int64_t>& of_query : frames_) {
    const auto end = at < frames.size() ? at + 1 + static_cast<std::size_t>(frames[at]) : at;
    if (at >= frames.size() || end > frames.size()) {
      throw core::InputError::expected(in.place(), "frames of all queries", "their end");
    }
    of_query.insert(frames.begin() + static_cast<std::ptrdiff_t>(at) + 1,
                    frames.begin() + static_cast<std::ptrdiff_t>(end));
    at = end;
  }
}

}  // namespace segsim::reconstruction::internal
