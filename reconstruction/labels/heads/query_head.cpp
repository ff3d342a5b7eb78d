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
#include "reconstruction/labels/internal/query_matching.h"
#include "reconstruction/labels/internal/query_set.h"
#include "reconstruction/labels/internal/sparse_blend.h"
#include "reconstruction/labels/query_pruning.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr std::int64_t kPruningSurfels = 100'000;  ///< Sampled for the overlap of queries.

/// What one batch renders, with derivatives.
struct Rendered {
  Tensor semantic_rows, instance_rows;  ///< Leaves: features of the batch's surfels.
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
    const BlendMatrix matrix = maker_.make(batch.weights, warps ? batch.warped : nullptr);
    const Tensor alpha = matrix.alpha.cpu();
    const BatchTargets targets =
        make_targets(batch, alpha.data_ptr<float>(), inputs_.classes, config_);
    if (targets.labelled.empty()) return {{"total", 0.0}};

    const Rendered rendered = render(matrix);
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
    const Tensor class_probability = add_semantic_loss(sum, matrix, rendered, targets);
    add_instance_losses(sum, rendered, matching, masks);
    add_class_loss(sum, rendered, targets, matching);
    if (progress >= config_.loss.panoptic_from) {
      add_panoptic_loss(sum, matrix, rendered, targets, matching, class_probability);
    }
    if (warps) add_warp_loss(sum, matrix, rendered, batch, alpha.data_ptr<float>());
    if (queries_.size() > 1) {
      sum.add("repulsion", config_.loss.repulsion,
              repulsion_loss(rendered.projected, config_.loss.repulsion_margin));
    }
    std::vector<NamedLoss> losses = sum.finish(iteration);
    optimise(matrix, rendered, rate_factor(config_.rate, progress));
    return losses;
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

  [[nodiscard]] Rendered render(const BlendMatrix& matrix) const {
    Rendered r;
    const auto leaf = [](const Tensor& value) { return value.detach().requires_grad_(true); };
    r.semantic_rows = leaf(semantic_.value().index_select(0, matrix.surfel));
    r.instance_rows = leaf(instance_.value().index_select(0, matrix.surfel));
    r.decoder_weight = leaf(decoder_weight_.value());
    r.decoder_bias = leaf(decoder_bias_.value());
    r.classes =
        torch::softmax(r.semantic_rows.matmul(r.decoder_weight.t()) + r.decoder_bias, 1);
    r.queries = queries_.leaves();
    r.projected = QuerySet::projected(r.queries);
    const Tensor logit =
        r.instance_rows.matmul(QuerySet::embedding(r.queries, r.projected).t());
    const Tensor distance2 =
        squared_distances(position_m_.index_select(0, matrix.surfel), r.queries.position_m,
                          r.queries.log_sigma, r.queries.rotation);
    r.labels = query_labels(logit, distance2, label_settings());
    r.masks = blend(matrix, r.labels);
    r.class_logits = QuerySet::class_logits(r.queries);
    return r;
  }

  /// @return  [pixels], blended probability of each pixel's class; 0 without one.
  Tensor add_semantic_loss(LossSum& sum, const BlendMatrix& matrix, const Rendered& rendered,
                           const BatchTargets& targets) const {
    Tensor at = blend_channel(matrix, rendered.classes,
                              padded_indices(targets.class_index, matrix.pixels, device_));
    const Tensor labelled = device_tensor(targets.labelled, torch::kInt64, device_);
    const Tensor weight = device_tensor(targets.weight, torch::kFloat32, device_);
    sum.add("semantic", config_.loss.semantic,
            negative_log_likelihood(at.index_select(0, labelled),
                                    weight.index_select(0, labelled)));
    return at;
  }

  /// Pixels but those of masks that got no query.
  [[nodiscard]] static std::vector<std::int64_t> without_unmatched(
      const std::vector<std::int64_t>& pixels, const BatchTargets& targets,
      const Matching& matching) {
    std::vector<std::int64_t> kept;
    for (const std::int64_t pixel : pixels) {
      const std::int64_t mask = targets.mask_index[static_cast<std::size_t>(pixel)];
      if (mask < 0 || matching.query_of[static_cast<std::size_t>(mask)] >= 0)
        kept.push_back(pixel);
    }
    return kept;
  }

  void add_instance_losses(LossSum& sum, const Rendered& rendered, const Matching& matching,
                           const MaskTargets& masks) const {
    if (matching.queries.empty()) return;
    const Tensor mask =
        rendered.masks.index_select(1, device_tensor(matching.queries, torch::kInt64, device_))
            .index_select(0, masks.pixels);
    const Tensor target =
        masks.one_hot.index_select(1, device_tensor(matching.masks, torch::kInt64, device_));
    sum.add("dice", config_.loss.dice, dice_losses(mask, target, masks.importance).mean());
    sum.add("bce", config_.loss.bce, bce_losses(mask, target, masks.weight).mean());
  }

  /// Matched queries learn the class of their mask; unmatched ones that win pixels here learn
  /// that they are nothing. What the frame does not show learns nothing.
  void add_class_loss(LossSum& sum, const Rendered& rendered, const BatchTargets& targets,
                      const Matching& matching) const {
    if (queries_.size() == 0) return;
    const auto no_object = static_cast<std::int64_t>(classes_.things.size());
    std::vector<std::int64_t> target(matching.visible.size(), no_object);
    std::vector<float> weight(matching.visible.size(), 0.0F);
    for (std::size_t q = 0; q < weight.size(); ++q) {
      if (matching.visible[q]) weight[q] = static_cast<float>(config_.loss.no_object);
    }
    for (std::size_t i = 0; i < matching.queries.size(); ++i) {
      const TargetMask& mask = targets.masks[static_cast<std::size_t>(matching.masks[i])];
      const auto q = static_cast<std::size_t>(matching.queries[i]);
      target[q] = classes_.thing_index[static_cast<std::size_t>(mask.class_index)];
      weight[q] = 1.0F;
    }
    sum.add("class", config_.loss.query_class,
            class_cross_entropy(rendered.class_logits,
                                device_tensor(target, torch::kInt64, device_),
                                device_tensor(weight, torch::kFloat32, device_)));
  }

  /// [surfels, stuff classes].
  [[nodiscard]] Tensor stuff_rows(const Rendered& rendered) const {
    return rendered.classes.index_select(
        1, device_tensor(classes_.stuff, torch::kInt64, device_));
  }
  /// [surfels, queries], what of a surfel's thing mass each query has: its label. What the
  /// none-score takes stays without a channel.
  [[nodiscard]] Tensor query_shares(const Rendered& rendered) const {
    if (config_.query.variant != renderer::LabelVariant::kRaw) return rendered.labels;
    return rendered.labels / (rendered.labels.sum(1, true) + 1e-6);
  }

  /// The parameter-free panoptic head: P(stuff c) = p_c, P(q) = (1 - sum of stuff) l_q,
  /// blended. Pixels of masks without a query are left out: PanopticRecon++ shifts them to the
  /// last stuff class by mistake.
  /// @param class_probability  Of add_semantic_loss().
  void add_panoptic_loss(LossSum& sum, const BlendMatrix& matrix, const Rendered& rendered,
                         const BatchTargets& targets, const Matching& matching,
                         const Tensor& class_probability) const {
    std::vector<std::int64_t> query(targets.class_index.size(), -1), used;
    std::vector<float> is_stuff;
    for (const std::int64_t pixel : targets.labelled) {
      const auto p = static_cast<std::size_t>(pixel);
      const std::int64_t mask = targets.mask_index[p];
      const bool stuff =
          classes_.stuff_index[static_cast<std::size_t>(targets.class_index[p])] >= 0;
      if (mask >= 0) query[p] = matching.query_of[static_cast<std::size_t>(mask)];
      if (!stuff && query[p] < 0) continue;
      used.push_back(pixel);
      is_stuff.push_back(stuff ? 1.0F : 0.0F);
    }
    if (used.empty()) return;
    const Tensor of_query = blend_channel(matrix, query_shares(rendered),
                                          padded_indices(query, matrix.pixels, device_),
                                          1.0 - stuff_rows(rendered).sum(1));
    const Tensor pixels = device_tensor(used, torch::kInt64, device_);
    const Tensor stuff = device_tensor(is_stuff, torch::kFloat32, device_);
    const Tensor weight = device_tensor(targets.weight, torch::kFloat32, device_);
    sum.add("panoptic", config_.loss.panoptic,
            negative_log_likelihood(class_probability.index_select(0, pixels) * stuff +
                                        of_query.index_select(0, pixels),
                                    weight.index_select(0, pixels)));
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
    const Tensor stuff = stuff_rows(rendered);
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
    queries_.keep(queries_to_keep(query_uses(), query_config()));
    queries_.forget_recent();
  }

  /// A short sequence has too few frames for the rule of min_frames.
  [[nodiscard]] QueryConfig query_config() const {
    QueryConfig config = config_.query;
    config.min_frames =
        static_cast<int>(std::min<std::int64_t>(config.min_frames, inputs_.frames));
    return config;
  }
  [[nodiscard]] std::vector<QueryUse> query_uses() const;
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

std::vector<QueryUse> QueryHead::query_uses() const {
  const at::NoGradGuard no_grad;
  std::vector<QueryUse> uses(static_cast<std::size_t>(queries_.size()));
  const std::int64_t stride = 1 + position_m_.size(0) / kPruningSurfels;
  const Tensor rows = torch::arange(0, position_m_.size(0), stride,
                                    position_m_.options().dtype(torch::kInt64));
  const QuerySet::Leaves leaves = queries_.leaves();
  const Tensor logit = instance_.value().index_select(0, rows).matmul(
      QuerySet::embedding(leaves, QuerySet::projected(leaves)).t());
  const Tensor distance2 = squared_distances(
      position_m_.index_select(0, rows), leaves.position_m, leaves.log_sigma, leaves.rotation);
  const Tensor attention =
      query_labels(logit, distance2, {renderer::LabelVariant::kRaw, 0.0, 1.0})
          .t()
          .cpu()
          .contiguous();
  const auto* a = attention.data_ptr<float>();
  for (std::size_t q = 0; q < uses.size(); ++q) {
    const auto query = static_cast<std::int64_t>(q);
    uses[q].matches = queries_.matches(query);
    uses[q].recent_matches = queries_.recent_matches(query);
    uses[q].frames = static_cast<std::int64_t>(queries_.frames(query));
    for (std::int64_t s = 0; s < rows.size(0); ++s) {
      if (static_cast<double>(a[query * rows.size(0) + s]) > config_.query.overlap_score) {
        uses[q].surfels.push_back(s);
      }
    }
  }
  return uses;
}

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

}  // namespace segsim::reconstruction::internal
