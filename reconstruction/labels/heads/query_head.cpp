// The paper's head: "Query-guided Instance Segmentation" and the label losses of "End-to-end
// Panoptic Reconstruction". Read QueryHead::step() first.

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/check.h"
#include "core/error.h"
#include "reconstruction/labels/internal/batch_targets.h"
#include "reconstruction/labels/internal/head_list.h"
#include "reconstruction/labels/internal/head_support.h"
#include "reconstruction/labels/internal/label_losses.h"
#include "reconstruction/labels/internal/query_losses.h"
#include "reconstruction/labels/internal/query_set.h"
#include "reconstruction/labels/internal/sparse_blend.h"
#include "reconstruction/labels/query_pruning.h"

namespace segsim::reconstruction::internal {
namespace {

/// What one batch renders, with derivatives.
struct Rendered {
  Tensor semantic_rows, instance_rows;  ///< Leaves: features of the batch's surfels.
  Tensor position_rows;                 ///< [surfels, 3]; a leaf in joint training.
  Tensor decoder_weight, decoder_bias;  ///< Leaves.
  QuerySet::Leaves queries;
  Tensor projected;     ///< [queries, 32], before the layer norm.
  Tensor classes;       ///< [surfels, classes], probabilities.
  Tensor labels;        ///< [surfels, queries].
  Tensor masks;         ///< [pixels, queries], blended labels.
  Tensor class_logits;  ///< [queries, T + 1].
};

class QueryHead : public PanopticHead {
 public:
  QueryHead(std::string name, PanopticHeadInputs inputs, const PanopticTrainingConfig& config,
            std::uint64_t seed, double warp_factor)
      : name_(std::move(name)),
        inputs_(std::move(inputs)),
        config_(config),
        warp_factor_(warp_factor),
        device_(device_of(inputs_.cuda_device)),
        classes_(split_classes(inputs_.classes)),
        maker_(static_cast<std::int64_t>(inputs_.position_m.size()), device_),
        position_m_(positions_tensor(inputs_.position_m, device_)),
        semantic_(surfel_features(core::kSemanticFeatureSize)),
        instance_(surfel_features(core::kInstanceFeatureSize)),
        decoder_weight_(linear_weight(class_count(), core::kSemanticFeatureSize, seed,
                                      "semantic_decoder", device_)),
        decoder_bias_(torch::zeros({class_count()}, decoder_weight_.value().options())),
        queries_(inputs_.query_seeds, static_cast<int>(classes_.things.size()), config, seed,
                 device_) {}

  std::vector<NamedLoss> step(const PanopticBatch& batch, std::int64_t iteration) override {
    const double progress =
        static_cast<double>(iteration) / static_cast<double>(config_.iterations);
    prune_when_due(iteration, progress);
    const bool warps = warp_factor_ > 0.0 && batch.warped != nullptr;
    const bool joint = batch.gradient != nullptr;
    const BlendMatrix matrix =
        maker_.make(batch.weights, warps ? batch.warped : nullptr, joint);
    const Tensor alpha = matrix.alpha.cpu();
    const BatchTargets targets =
        make_targets(batch, alpha.data_ptr<float>(), inputs_.classes, config_);
    if (targets.labelled.empty()) return {{"total", 0.0}};

    const Rendered rendered = render(matrix, joint);
    const std::vector<std::int64_t>& instance_pixels =
        config_.void_policy == VoidPolicy::kNegative ? targets.valid : targets.labelled;
    const MaskTargets all_masks = mask_targets(targets, instance_pixels, device_);
    const Matching matching = match_queries(
        rendered.masks.index_select(0, all_masks.pixels), rendered.class_logits, targets,
        all_masks, classes_, config_.query, progress >= config_.query.gate_from);
    for (const std::int64_t query : matching.queries) queries_.count_match(query, batch.frame);
    const MaskTargets masks =
        config_.query.ignore_unmatched
            ? mask_targets(targets, without_unmatched(instance_pixels, targets, matching),
                           device_)
            : all_masks;

    LossSum sum;
    const Tensor class_probability =
        add_semantic_loss(sum, config_.loss.semantic, matrix, rendered.classes, targets);
    add_instance_losses(sum, rendered.masks, matching, masks,
                        {config_.loss.dice, config_.loss.bce});
    if (queries_.size() > 0) {
      sum.add("class", config_.loss.query_class,
              query_class_loss(rendered.class_logits, targets, matching, classes_,
                               config_.loss.no_object));
    }
    if (progress >= config_.loss.panoptic_from) {
      const Tensor panoptic = panoptic_loss(matrix, {rendered.classes, query_shares(rendered)},
                                            class_probability, targets, matching, classes_);
      if (panoptic.defined()) sum.add("panoptic", config_.loss.panoptic, panoptic);
    }
    if (warps) add_warp_loss(sum, matrix, rendered, batch, alpha.data_ptr<float>());
    if (queries_.size() > 1) {
      sum.add("repulsion", config_.loss.repulsion,
              repulsion_loss(rendered.projected, config_.loss.repulsion_margin));
    }
    std::vector<NamedLoss> losses = sum.finish(iteration);
    if (joint) *batch.gradient = geometry_gradient(matrix, batch, rendered.position_rows);
    optimise(matrix, rendered, rate_factor(config_.rate, progress));
    return losses;
  }

  void move_surfels(const std::vector<glm::vec3>& position_m) override {
    SEGSIM_CHECK(position_m.size() == inputs_.position_m.size(), "surfels");
    inputs_.position_m = position_m;
    position_m_ = positions_tensor(position_m, device_);
  }

  [[nodiscard]] PanopticResult result() const override;
  void save(const std::filesystem::path& file) const override;
  void load(const std::filesystem::path& file) override;

 private:
  [[nodiscard]] std::int64_t class_count() const {
    return static_cast<std::int64_t>(inputs_.classes.size());
  }
  [[nodiscard]] Tensor surfel_features(std::int64_t size) const {
    return torch::zeros({position_m_.size(0), size}, position_m_.options());
  }
  [[nodiscard]] LabelSettings label_settings() const {
    return {config_.query.variant, config_.query.none_score, config_.query.temperature};
  }

  [[nodiscard]] Rendered render(const BlendMatrix& matrix, bool joint) const {
    Rendered r;
    const auto leaf = [](const Tensor& value) { return value.detach().requires_grad_(true); };
    r.semantic_rows = leaf(semantic_.value().index_select(0, matrix.surfel));
    r.instance_rows = leaf(instance_.value().index_select(0, matrix.surfel));
    r.position_rows = position_m_.index_select(0, matrix.surfel).requires_grad_(joint);
    r.decoder_weight = leaf(decoder_weight_.value());
    r.decoder_bias = leaf(decoder_bias_.value());
    r.classes =
        torch::softmax(r.semantic_rows.matmul(r.decoder_weight.t()) + r.decoder_bias, 1);
    r.queries = queries_.leaves();
    r.projected = QuerySet::projected(r.queries);
    const Tensor logit =
        r.instance_rows.matmul(QuerySet::embedding(r.queries, r.projected).t());
    const Tensor distance2 = squared_distances(r.position_rows, r.queries.position_m,
                                               r.queries.log_sigma, r.queries.rotation);
    r.labels = query_labels(logit, distance2, label_settings());
    r.masks = blend(matrix, r.labels);
    r.class_logits = QuerySet::class_logits(r.queries);
    return r;
  }

  /// [surfels, queries], what of a surfel's thing mass each query has: its label. What the
  /// none-score takes stays without a channel.
  [[nodiscard]] Tensor query_shares(const Rendered& rendered) const {
    if (config_.query.variant != renderer::LabelVariant::kRaw) return rendered.labels;
    return rendered.labels / (rendered.labels.sum(1, true) + 1e-6);
  }

  /// The rows below the batch's own show points of it in a neighbouring frame.
  void add_warp_loss(LossSum& sum, const BlendMatrix& matrix, const Rendered& rendered,
                     const PanopticBatch& batch, const float* alpha) const {
    const auto covered = [&](std::int64_t row) {
      return static_cast<double>(alpha[row]) >= config_.sampling.min_alpha;
    };
    std::vector<std::int64_t> here, there;
    for (std::int64_t p = 0; p < batch.weights.pixels; ++p) {
      const std::int64_t row = batch.weights.pixels + batch.warped_row[p];
      if (batch.warped_row[p] < 0 || !covered(p) || !covered(row)) continue;
      here.push_back(p);
      there.push_back(row);
    }
    if (here.empty()) return;
    const Tensor stuff = stuff_rows(rendered.classes, classes_);
    const Tensor map = blend(
        matrix, torch::cat({stuff, (1.0 - stuff.sum(1, true)) * query_shares(rendered)}, 1));
    sum.add("warp", warp_factor_,
            symmetric_kl(map.index_select(0, device_tensor(here, torch::kInt64, device_)),
                         map.index_select(0, device_tensor(there, torch::kInt64, device_))));
  }

  void optimise(const BlendMatrix& matrix, const Rendered& rendered, double factor) {
    const auto step_rows = [&](AdamTensor& parameter, const Tensor& leaf, double rate) {
      if (leaf.grad().defined())
        parameter.step_rows(matrix.surfel, leaf.grad(), rate * factor);
    };
    step_rows(semantic_, rendered.semantic_rows, config_.rate.semantic_feature);
    step_rows(instance_, rendered.instance_rows, config_.rate.instance_feature);
    const auto step = [&](AdamTensor& parameter, const Tensor& leaf) {
      if (leaf.grad().defined()) parameter.step(leaf.grad(), config_.rate.decoder * factor);
    };
    step(decoder_weight_, rendered.decoder_weight);
    step(decoder_bias_, rendered.decoder_bias);
    queries_.step(rendered.queries, config_.rate, factor);
  }

  /// Pruning waits until every frame had its turn since the last one.
  void prune_when_due(std::int64_t iteration, double progress) {
    const auto planned = static_cast<std::int64_t>(config_.query.prune_every *
                                                   static_cast<double>(config_.iterations));
    const std::int64_t interval = std::max({std::int64_t{1}, planned, inputs_.frames});
    if (progress < config_.query.prune_from || iteration == 0 || iteration % interval != 0) {
      return;
    }
    queries_.keep(queries_to_keep(
        query_uses(queries_, instance_.value(), position_m_, config_.query.overlap_score),
        query_config()));
    queries_.forget_recent();
  }

  /// A short sequence has too few frames for the rule of min_frames.
  [[nodiscard]] QueryConfig query_config() const {
    QueryConfig config = config_.query;
    config.min_frames =
        static_cast<int>(std::min<std::int64_t>(config.min_frames, inputs_.frames));
    return config;
  }
  [[nodiscard]] renderer::PanopticModel model() const;

  std::string name_;
  PanopticHeadInputs inputs_;
  PanopticTrainingConfig config_;
  double warp_factor_;
  at::Device device_;
  ClassSplit classes_;
  BlendMatrixMaker maker_;
  Tensor position_m_;               ///< [surfels, 3].
  AdamTensor semantic_, instance_;  ///< [surfels, 16], [surfels, 32].
  AdamTensor decoder_weight_, decoder_bias_;
  QuerySet queries_;
};

/// Queries that were never matched in enough frames are not part of the result.
renderer::PanopticModel QueryHead::model() const {
  const at::NoGradGuard no_grad;
  renderer::PanopticModel model;
  model.variant = config_.query.variant;
  model.temperature = static_cast<float>(config_.query.temperature);
  model.none_score = static_cast<float>(model.variant == renderer::LabelVariant::kRaw
                                            ? config_.query.raw_none_score
                                            : config_.query.none_score);
  model.classes = decoder_classes(inputs_.classes, decoder_weight_.value().cpu(),
                                  decoder_bias_.value().cpu());
  const QuerySet::Leaves leaves = queries_.leaves();
  const Tensor position = leaves.position_m.cpu(), sigma = leaves.log_sigma.exp().cpu(),
               rotation = leaves.rotation.cpu(),
               feature = QuerySet::embedding(leaves, QuerySet::projected(leaves)).cpu(),
               logits = QuerySet::class_logits(leaves).cpu();
  for (std::int64_t q = 0; q < queries_.size(); ++q) {
    if (static_cast<int>(queries_.frames(q)) < query_config().min_frames) continue;
    renderer::InstanceQuery query;
    query.id = static_cast<std::uint16_t>(model.queries.size() + 1);
    const auto at = [q](const Tensor& t, int i) {
      return t.data_ptr<float>()[q * t.size(1) + i];
    };
    query.position_m = {at(position, 0), at(position, 1), at(position, 2)};
    query.sigma_m = {at(sigma, 0), at(sigma, 1), at(sigma, 2)};
    query.R_world_query = glm::normalize(
        glm::quat(at(rotation, 0), at(rotation, 1), at(rotation, 2), at(rotation, 3)));
    for (int i = 0; i < core::kInstanceFeatureSize; ++i) {
      query.feature[static_cast<std::size_t>(i)] = at(feature, i);
    }
    int best = -1;
    for (int t = 0; t < static_cast<int>(classes_.things.size()); ++t) {
      if (best < 0 || at(logits, t) > at(logits, best)) best = t;
    }
    if (best >= 0) {
      const auto c = static_cast<std::size_t>(classes_.things[static_cast<std::size_t>(best)]);
      query.class_id = inputs_.classes[c].id;
    }
    model.queries.push_back(query);
  }
  return model;
}

PanopticResult QueryHead::result() const {
  PanopticResult result;
  result.model = model();
  result.semantic_feature = rows_of<core::SemanticFeature>(semantic_.value());
  result.instance_feature = rows_of<core::InstanceFeature>(instance_.value());
  result.field = renderer::fold_panoptic_model(
      feature_cloud(inputs_.position_m, result.semantic_feature, result.instance_feature),
      *result.model);
  return result;
}

void QueryHead::save(const std::filesystem::path& file) const {
  StateWriter out(name_);
  semantic_.save(out, "surfel.semantic");
  instance_.save(out, "surfel.instance");
  decoder_weight_.save(out, "decoder.weight");
  decoder_bias_.save(out, "decoder.bias");
  queries_.save(out);
  out.write(file);
}

void QueryHead::load(const std::filesystem::path& file) {
  const StateReader in(file, name_);
  in.expect_rows("surfel.semantic", position_m_.size(0));
  in.expect_rows("decoder.weight", class_count());
  semantic_.load(in, "surfel.semantic");
  instance_.load(in, "surfel.instance");
  decoder_weight_.load(in, "decoder.weight");
  decoder_bias_.load(in, "decoder.bias");
  queries_.load(in);
}

}  // namespace

std::unique_ptr<PanopticHead> make_query_head(std::string name, PanopticHeadInputs inputs,
                                              const PanopticTrainingConfig& config,
                                              std::uint64_t seed, double warp_factor) {
  return std::make_unique<QueryHead>(std::move(name), std::move(inputs), config, seed,
                                     warp_factor);
}

constinit const HeadMaker kMakeQuery =
    [](PanopticHeadInputs inputs, const PanopticTrainingConfig& config, std::uint64_t seed) {
      return make_query_head("query", std::move(inputs), config, seed, config.loss.warp);
    };

}  // namespace segsim::reconstruction::internal
