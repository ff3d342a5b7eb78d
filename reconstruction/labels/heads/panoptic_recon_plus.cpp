// PanopticRecon++ (Yu et al., arXiv 2501.01119) on surfels: queries are Gaussians in space
// with features, a surfel's attention to them is the likeness of features times the density of
// the Gaussian there, and places, shapes and features of the queries are learnt from masks
// that are assigned anew in every image. The number of queries adapts by pruning. In a last
// stage only the panoptic head, which shares out the mass that no stuff class has, and the
// masks' cross entropy are supervised. Read PanopticReconPlusHead::step() first.
//
// Departures from the published program:
//   - features are parameters of surfels instead of two hash grids, at rates that follow; the
//     decoder of classes has a higher rate, too, and all rates are those of shorter runs;
//   - a distance field with its losses (L_sdf, L_eik) is not here: geometry is that of the
//     surfels, and with the frozen one the first, geometric epochs fall away;
//   - probabilities are compared by their logarithms. The program puts probabilities through
//     another softmax (classes, queries, panoptic map) and masks through another sigmoid,
//     which large factors make up for; factors here are their ratios;
//   - the panoptic map gives pixels of masks without a query no target. The program makes them
//     the last stuff class by mistake, and loses the mask with the lowest id where no
//     unlabelled pixel was drawn;
//   - classes have no channel "unlabelled": nothing ever teaches it;
//   - features of queries begin with noise, because the repulsion of equal ones has no
//     direction, and it acts on their distance alone;
//   - an iteration sees one image instead of ten with fewer pixels of each;
//   - of two queries that claim the same surfels the less matched goes instead of the smaller,
//     and surfels take the place of its thinned cloud;
//   - exported pixels follow the renderer: the class is the one with most of the mass, and of
//     a thing class the query with most of it gives id and class.

#include <algorithm>

#include "core/check.h"
#include "reconstruction/labels/internal/batch_targets.h"
#include "reconstruction/labels/internal/class_logits.h"
#include "reconstruction/labels/internal/head_list.h"
#include "reconstruction/labels/internal/label_losses.h"
#include "reconstruction/labels/internal/query_losses.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr const char* kName = "panoptic-recon++";
constexpr std::int64_t kFeatures = 32;   ///< Of a surfel, for classes and for instances.
constexpr std::int64_t kHidden = 128;    ///< Of the decoder.
constexpr double kSoftplusBeta = 100.0;  ///< Of the decoder.

/// What one batch renders, with derivatives.
struct Rendered {
  Tensor semantic_rows, instance_rows, position_rows;  ///< Of the batch's surfels.
  Tensor weight1, bias1, weight2, bias2;               ///< Leaves: the decoder.
  QuerySet::Leaves queries;
  Tensor projected;  ///< [queries, 32], before the layer norm.
  Tensor classes;    ///< [surfels, classes], probabilities.
  Tensor attention;  ///< [surfels, queries], A.
  Tensor masks;      ///< [pixels, queries], blended A.
  Tensor class_logits;
};

class PanopticReconPlusHead : public PanopticHead {
 public:
  PanopticReconPlusHead(PanopticHeadInputs inputs, const PanopticTrainingConfig& config,
                        std::uint64_t seed)
      : inputs_(std::move(inputs)),
        config_(recon_plus_config(config)),
        device_(device_of(inputs_.cuda_device)),
        classes_(split_classes(inputs_.classes)),
        maker_(static_cast<std::int64_t>(inputs_.position_m.size()), device_),
        position_m_(positions_tensor(inputs_.position_m, device_)),
        semantic_(torch::zeros({position_m_.size(0), kFeatures}, position_m_.options())),
        instance_(torch::zeros({position_m_.size(0), kFeatures}, position_m_.options())),
        weight1_(linear_weight(kHidden, kFeatures, seed, "decoder_1", device_)),
        bias1_(linear_weight(kHidden, kFeatures, seed, "decoder_bias", device_).select(1, 0)),
        weight2_(linear_weight(class_count(), kHidden, seed, "decoder_2", device_)),
        bias2_(torch::zeros({class_count()}, position_m_.options())),
        queries_(inputs_.query_seeds, static_cast<int>(classes_.things.size()), config_, seed,
                 device_) {}

  std::vector<NamedLoss> step(const PanopticBatch& batch, std::int64_t iteration) override {
    const PanopticReconPlusConfig& plus = config_.panoptic_recon_plus;
    const double progress =
        static_cast<double>(iteration) / static_cast<double>(config_.iterations);
    prune_when_due(iteration, progress);
    const bool joint = batch.gradient != nullptr;
    const BlendMatrix matrix = maker_.make(batch.weights, nullptr, joint);
    const Tensor alpha = matrix.alpha.cpu();
    const BatchTargets targets =
        make_targets(batch, alpha.data_ptr<float>(), inputs_.classes, config_);
    if (targets.labelled.empty()) return {{"total", 0.0}};

    const Rendered rendered = render(matrix, joint);
    // Unlabelled pixels are of no instance, and those of a mask without a query neither.
    const MaskTargets masks = mask_targets(
        targets, plus.unlabelled_negative ? targets.valid : targets.labelled, device_);
    const Matching matching =
        match_queries(rendered.masks.index_select(0, masks.pixels), rendered.class_logits,
                      targets, masks, classes_, config_.query, /*gated=*/true);
    for (const std::int64_t query : matching.queries) queries_.count_match(query, batch.frame);

    const bool last_stage = progress >= plus.panoptic_from;
    LossSum sum;
    const Tensor class_probability = add_semantic_loss(sum, last_stage ? 0.0 : plus.semantic,
                                                       matrix, rendered.classes, targets);
    add_instance_losses(sum, rendered.masks, matching, masks,
                        {last_stage ? 0.0 : plus.instance, plus.instance});
    if (!matching.queries.empty()) {
      sum.add("class", plus.instance,
              query_class_loss(rendered.class_logits, targets, matching, classes_,
                               /*no_object=*/0.0));
    }
    if (last_stage) {
      const Tensor panoptic =
          panoptic_loss(matrix, {rendered.classes, shares(rendered.attention)},
                        class_probability, targets, matching, classes_);
      if (panoptic.defined()) sum.add("panoptic", plus.panoptic, panoptic);
    }
    if (queries_.size() > 1) {
      sum.add("repulsion", plus.repulsion,
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

  [[nodiscard]] static Tensor decoded(const Tensor& feature, const Rendered& r) {
    const Tensor hidden = at::softplus(feature.matmul(r.weight1.t()) + r.bias1, kSoftplusBeta);
    return torch::softmax(hidden.matmul(r.weight2.t()) + r.bias2, 1);
  }
  /// What of a surfel's thing mass each query has.
  [[nodiscard]] static Tensor shares(const Tensor& attention) {
    return attention / (attention.sum(1, true) + 1e-6);
  }

  /// @param differentiable  By the surfels' places.
  [[nodiscard]] Rendered render_rows(const Tensor& surfel, bool differentiable) const {
    Rendered r;
    const auto leaf = [](const Tensor& value) { return value.detach().requires_grad_(true); };
    r.semantic_rows = leaf(semantic_.value().index_select(0, surfel));
    r.instance_rows = leaf(instance_.value().index_select(0, surfel));
    r.position_rows = position_m_.index_select(0, surfel).requires_grad_(differentiable);
    r.weight1 = leaf(weight1_.value());
    r.bias1 = leaf(bias1_.value());
    r.weight2 = leaf(weight2_.value());
    r.bias2 = leaf(bias2_.value());
    r.classes = decoded(r.semantic_rows, r);
    r.queries = queries_.leaves();
    r.projected = QuerySet::projected(r.queries);
    const Tensor logit =
        r.instance_rows.matmul(QuerySet::embedding(r.queries, r.projected).t());
    const Tensor distance2 = squared_distances(r.position_rows, r.queries.position_m,
                                               r.queries.log_sigma, r.queries.rotation);
    r.attention = query_labels(logit, distance2, {renderer::LabelVariant::kRaw, 0.0, 1.0});
    r.class_logits = QuerySet::class_logits(r.queries);
    return r;
  }
  [[nodiscard]] Rendered render(const BlendMatrix& matrix, bool differentiable) const {
    Rendered r = render_rows(matrix.surfel, differentiable);
    r.masks = blend(matrix, r.attention);
    return r;
  }

  void optimise(const BlendMatrix& matrix, const Rendered& r, double factor) {
    const PanopticReconPlusConfig& plus = config_.panoptic_recon_plus;
    const auto step_rows = [&](AdamTensor& parameter, const Tensor& leaf) {
      if (leaf.grad().defined())
        parameter.step_rows(matrix.surfel, leaf.grad(), plus.feature_rate * factor);
    };
    step_rows(semantic_, r.semantic_rows);
    step_rows(instance_, r.instance_rows);
    const auto step = [&](AdamTensor& parameter, const Tensor& leaf) {
      if (leaf.grad().defined()) parameter.step(leaf.grad(), plus.decoder_rate * factor);
    };
    step(weight1_, r.weight1);
    step(bias1_, r.bias1);
    step(weight2_, r.weight2);
    step(bias2_, r.bias2);
    queries_.step(r.queries, config_.rate, factor);
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
        config_.query));
    queries_.forget_recent();
  }

  PanopticHeadInputs inputs_;
  PanopticTrainingConfig config_;
  at::Device device_;
  ClassSplit classes_;
  BlendMatrixMaker maker_;
  Tensor position_m_;               ///< [surfels, 3].
  AdamTensor semantic_, instance_;  ///< [surfels, 32].
  AdamTensor weight1_, bias1_, weight2_, bias2_;
  QuerySet queries_;
};

/// The panoptic head of every surfel: stuff classes keep their mass, queries share the rest,
/// and a thing class has what the queries of that class have.
PanopticResult PanopticReconPlusHead::result() const {
  const at::NoGradGuard no_grad;
  const std::int64_t all = position_m_.size(0);
  const Rendered r =
      render_rows(torch::arange(0, all, position_m_.options().dtype(torch::kInt64)), false);
  Tensor classes = r.classes, instances = shares(r.attention);
  PanopticResult result;
  std::vector<std::uint16_t> class_of_query;
  if (queries_.size() > 0 && !classes_.things.empty()) {
    const auto things = static_cast<std::int64_t>(classes_.things.size());
    const Tensor best = r.class_logits.narrow(1, 0, things).argmax(1);  // Among things.
    const Tensor thing =
        device_tensor(classes_.things, torch::kInt64, device_).index_select(0, best);
    instances = instances * (1.0 - stuff_rows(classes, classes_).sum(1, true));
    const Tensor stuff =
        torch::zeros({class_count()}, classes.options())
            .index_fill(0, device_tensor(classes_.stuff, torch::kInt64, device_), 1.0);
    classes = (classes * stuff).index_add(1, thing, instances);
    const Tensor on_host = thing.cpu();
    for (std::int64_t q = 0; q < queries_.size(); ++q) {
      const auto c = static_cast<std::size_t>(on_host.data_ptr<std::int64_t>()[q]);
      class_of_query.push_back(inputs_.classes[c].id);
    }
  }
  result.field = field_of_classes(inputs_.classes, classes);
  result.field.instances = scores_of_probabilities(instances);
  for (std::int64_t q = 1; q <= queries_.size(); ++q) {
    result.field.instance_id.push_back(static_cast<std::uint16_t>(q));
  }
  result.field.instance_class = std::move(class_of_query);
  return result;
}

void PanopticReconPlusHead::save(const std::filesystem::path& file) const {
  StateWriter out(kName);
  semantic_.save(out, "surfel.semantic");
  instance_.save(out, "surfel.instance");
  weight1_.save(out, "decoder.weight1");
  bias1_.save(out, "decoder.bias1");
  weight2_.save(out, "decoder.weight2");
  bias2_.save(out, "decoder.bias2");
  queries_.save(out);
  out.write(file);
}

void PanopticReconPlusHead::load(const std::filesystem::path& file) {
  const StateReader in(file, kName);
  in.expect_rows("surfel.semantic", position_m_.size(0));
  in.expect_rows("decoder.weight2", class_count());
  semantic_.load(in, "surfel.semantic");
  instance_.load(in, "surfel.instance");
  weight1_.load(in, "decoder.weight1");
  bias1_.load(in, "decoder.bias1");
  weight2_.load(in, "decoder.weight2");
  bias2_.load(in, "decoder.bias2");
  queries_.load(in);
}

}  // namespace

constinit const HeadMaker kMakePanopticReconPlus = make_head<PanopticReconPlusHead>;

}  // namespace segsim::reconstruction::internal
