// Contrastive Lift (Bhalgat et al., NeurIPS 2023) on surfels: every surfel has a short feature
// that is alike within a mask and different between the masks of an image, and a second, slow
// one that follows it. Ids are clusters of rendered features; no mask is ever compared with
// one of another image. Classes are learned as in Panoptic Lifting, a tenth of the training
// later. Read ContrastiveLiftHead::step() first.
//
// Departures from the published program:
//   - features are parameters of surfels instead of outputs of networks on positions, so rates
//     are higher, and more pixels take part in a step;
//   - points to cluster are rendered at pixels that lie in masks of things;
//   - a point's weight in the mean of its cluster is its density there, as HDBSCAN has it, and
//     the nearest mean is found for a pixel's rendered feature exactly, because
//     -|f - c|^2 = 2 f.c - |c|^2 - |f|^2 is linear in f but for a term that all means share.

#include <cmath>

#include "core/random.h"
#include "reconstruction/labels/internal/class_logits.h"
#include "reconstruction/labels/internal/density_clusters.h"
#include "reconstruction/labels/internal/head_list.h"
#include "reconstruction/labels/internal/pixel_store.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr const char* kName = "contrastive-lift";
constexpr std::int64_t kFeatureSize = 3;
constexpr double kOutlierSigmas = 3.0;

/// Pixels of masks, half of them to be rendered fast, half slow.
struct Halves {
  Tensor fast, slow;            ///< Rows of the batch.
  Tensor fast_mask, slow_mask;  ///< [rows], index of the mask.
  Tensor fast_confidence;       ///< [rows].
};

class ContrastiveLiftHead : public PanopticHead {
 public:
  ContrastiveLiftHead(PanopticHeadInputs inputs, const PanopticTrainingConfig& config,
                      std::uint64_t seed)
      : inputs_(std::move(inputs)),
        config_(config),
        seed_(seed),
        device_(device_of(inputs_.cuda_device)),
        maker_(surfels(), device_),
        semantic_(surfels(), static_cast<std::int64_t>(inputs_.classes.size()), device_),
        fast_(noise()),
        slow_(fast_.value().clone()),
        store_(inputs_.frames, config.contrastive_lift.clustering.points, seed, device_) {}

  std::vector<NamedLoss> step(const PanopticBatch& batch, std::int64_t iteration) override {
    const ContrastiveLiftConfig& lift = config_.contrastive_lift;
    const double progress =
        static_cast<double>(iteration) / static_cast<double>(config_.iterations);
    const BlendMatrix matrix = maker_.make(batch.weights);
    const Tensor alpha = matrix.alpha.cpu();
    const BatchTargets targets =
        make_targets(batch, alpha.data_ptr<float>(), inputs_.classes, config_);
    if (targets.labelled.empty()) return {{"total", 0.0}};
    const MaskTargets masks = mask_targets(targets, targets.labelled, device_);
    std::vector<std::int64_t> in_masks;
    for (const std::int64_t pixel : targets.labelled) {
      if (targets.mask_index[static_cast<std::size_t>(pixel)] >= 0) in_masks.push_back(pixel);
    }
    store_.keep(batch, matrix, targets, in_masks);

    const ClassLogits::Rendered classes = semantic_.render(matrix, masks);
    const Tensor fast_rows =
        fast_.value().index_select(0, matrix.surfel).detach().requires_grad_(true);
    LossSum sum;
    if (progress >= lift.semantic_from) {
      semantic_.add_class_loss(sum, config_.panoptic_lifting.semantic, classes, targets,
                               masks);
    }
    if (progress >= lift.segment_from) {
      semantic_.add_segment_loss(sum, config_.panoptic_lifting.segment, classes, masks);
    }
    if (progress >= lift.instance_from && in_masks.size() >= 2) {
      slow_.lerp_(fast_.value(), 1.0 - lift.slow_momentum);
      add_instance_losses(sum, matrix, fast_rows,
                          halves_of(std::move(in_masks), batch, targets, iteration));
    }
    std::vector<NamedLoss> losses = sum.finish(iteration);
    const double factor = rate_factor(config_.rate, progress);
    semantic_.step(matrix, classes, config_.panoptic_lifting.rate * factor);
    if (fast_rows.grad().defined()) {
      fast_.step_rows(matrix.surfel, fast_rows.grad(), lift.rate * factor);
    }
    return losses;
  }

  [[nodiscard]] PanopticResult result() const override {
    PanopticResult result;
    const Tensor probability = semantic_.probabilities();
    result.field = field_of_classes(inputs_.classes, probability);
    const Tensor logits = cluster_logits(probability);
    result.field.instances = scores_of_logits(logits);
    for (std::int64_t id = 1; id <= logits.size(1); ++id) {
      result.field.instance_id.push_back(static_cast<std::uint16_t>(id));
    }
    return result;
  }

  void save(const std::filesystem::path& file) const override {
    StateWriter out(kName);
    semantic_.save(out);
    fast_.save(out, "surfel.fast");
    out.put("surfel.slow", slow_);
    store_.save(out);
    out.write(file);
  }
  void load(const std::filesystem::path& file) override {
    const StateReader in(file, kName);
    semantic_.load(in);
    fast_.load(in, "surfel.fast");
    slow_ = in.take("surfel.slow", slow_);
    store_.load(in);
  }

 private:
  [[nodiscard]] std::int64_t surfels() const {
    return static_cast<std::int64_t>(inputs_.position_m.size());
  }
  [[nodiscard]] Tensor noise() const {
    core::RandomStream random(seed_, "contrastive_features");
    std::vector<float> values;
    for (std::int64_t i = 0; i < surfels() * kFeatureSize; ++i) {
      values.push_back(
          static_cast<float>(config_.contrastive_lift.feature_noise * random.normal()));
    }
    return device_tensor(values, torch::kFloat32, device_).view({-1, kFeatureSize});
  }

  [[nodiscard]] Halves halves_of(std::vector<std::int64_t> pixels, const PanopticBatch& batch,
                                 const BatchTargets& targets, std::int64_t iteration) const {
    core::RandomStream random(seed_, "contrastive_pixels",
                              static_cast<std::uint64_t>(iteration));
    const auto count =
        std::min(pixels.size(), static_cast<std::size_t>(config_.contrastive_lift.pixels));
    std::vector<std::int64_t> rows[2], masks[2];
    std::vector<float> confidence;
    for (std::size_t i = 0; i < count; ++i) {
      std::swap(pixels[i],
                pixels[i + random.index(static_cast<std::uint32_t>(pixels.size() - i))]);
      const auto p = static_cast<std::size_t>(pixels[i]);
      const std::size_t half = i < count / 2 ? 0 : 1;
      rows[half].push_back(pixels[i]);
      masks[half].push_back(targets.mask_index[p]);
      if (half == 1) continue;
      const bool scored = config_.use_confidence && batch.confidence != nullptr;
      confidence.push_back(scored ? batch.confidence[p] : 1.0F);
    }
    return {device_tensor(rows[0], torch::kInt64, device_),
            device_tensor(rows[1], torch::kInt64, device_),
            device_tensor(masks[0], torch::kInt64, device_),
            device_tensor(masks[1], torch::kInt64, device_),
            device_tensor(confidence, torch::kFloat32, device_)};
  }

  /// Fast features are drawn to the slow ones of their mask, and told from those of others.
  void add_instance_losses(LossSum& sum, const BlendMatrix& matrix, const Tensor& fast_rows,
                           const Halves& halves) const {
    const Tensor fast = blend(matrix, fast_rows).index_select(0, halves.fast);
    const Tensor slow =
        blend(matrix, slow_.index_select(0, matrix.surfel)).index_select(0, halves.slow);
    const Tensor same = halves.fast_mask.unsqueeze(1)
                            .eq(halves.slow_mask.unsqueeze(0))
                            .to(torch::kFloat32);  // [fast, slow]
    const Tensor partners = same.sum(1);
    const Tensor both = partners.gt(0.5).nonzero().squeeze(1);
    if (both.size(0) == 0) return;

    const Tensor mean = same.matmul(slow) / partners.clamp_min(1.0).unsqueeze(1);
    const Tensor near = halves.fast_confidence * torch::exp(-(fast - mean).pow(2).sum(1));
    // Every mask counts the same, whatever its number of pixels.
    const Tensor of_mask = halves.fast_mask.unsqueeze(1)
                               .eq(halves.fast_mask.unsqueeze(0))
                               .to(torch::kFloat32)
                               .sum(1);
    const Tensor share = (partners.gt(0.5).to(torch::kFloat32) / of_mask);
    sum.add("concentration", config_.contrastive_lift.instance,
            -(near * share).sum() / share.sum());

    // The floor keeps the derivative of the root finite for equal features.
    const Tensor distance =
        ((fast.unsqueeze(1) - slow.unsqueeze(0)).pow(2).sum(2) + 1e-12).sqrt();
    const Tensor likeness = torch::exp(torch::exp(-distance));
    const Tensor p = (likeness * same).sum(1) / likeness.sum(1);
    sum.add("contrast", config_.contrastive_lift.instance,
            -torch::log(p.index_select(0, both)).mean());
  }

  /// [surfels, clusters]: blended, the largest is the cluster whose mean is nearest.
  [[nodiscard]] Tensor cluster_logits(const Tensor& probability) const {
    const at::NoGradGuard no_grad;
    const DensityClusteringConfig& clustering = config_.contrastive_lift.clustering;
    const Tensor none = torch::zeros({surfels(), 0}, fast_.value().options());
    std::vector<std::int64_t> thing;
    if (store_.size() == 0) return none;
    const Tensor class_of = store_.blend(probability).argmax(1).cpu();
    for (std::int64_t i = 0; i < store_.size(); ++i) {
      const auto c = static_cast<std::size_t>(class_of.data_ptr<std::int64_t>()[i]);
      if (inputs_.classes[c].thing) thing.push_back(i);
    }
    if (thing.size() < 2) return none;
    Tensor feature = store_.blend(fast_.value())
                         .index_select(0, device_tensor(thing, torch::kInt64, device_));
    const Tensor far =
        (feature - feature.mean(0)).abs() > kOutlierSigmas * feature.std(0, false) + 1e-6;
    feature = feature.index_select(0, far.any(1).logical_not().nonzero().squeeze(1));
    if (feature.size(0) < 2) return none;
    const Tensor low = feature.amin(0);
    const Tensor range = (feature.amax(0) - low).clamp_min(1e-6);
    feature = ((feature - low) / range).cpu().contiguous();

    const auto points = static_cast<std::size_t>(feature.size(0));
    const std::span<const float> values{feature.data_ptr<float>(), points * kFeatureSize};
    const DensityClusters clusters =
        density_clusters(values, kFeatureSize, cluster_options(clustering, points, true));
    if (clusters.count == 0) return none;
    const Tensor mean =
        device_tensor(cluster_means(values, kFeatureSize, clusters), torch::kFloat32, device_)
            .view({-1, kFeatureSize});
    const Tensor scaled = (fast_.value() - low) / range;
    return 2.0 * scaled.matmul(mean.t()) - mean.pow(2).sum(1);
  }

  PanopticHeadInputs inputs_;
  PanopticTrainingConfig config_;
  std::uint64_t seed_;
  at::Device device_;
  BlendMatrixMaker maker_;
  ClassLogits semantic_;
  AdamTensor fast_;  ///< [surfels, 3].
  Tensor slow_;      ///< The same, a running mean; without derivatives.
  PixelStore store_;
};

}  // namespace

constinit const HeadMaker kMakeContrastiveLift = make_head<ContrastiveLiftHead>;

}  // namespace segsim::reconstruction::internal
