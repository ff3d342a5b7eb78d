// Panoptic Lifting (Siddiqui et al., CVPR 2023) on surfels: every surfel has logits of the
// classes and of a fixed number of instance slots, instead of the original's networks on
// positions. Losses and stages follow the published code; the segment loss takes the masks of
// the frame as its segments.

#include "core/error.h"
#include "reconstruction/internal/tensors/adam.h"
#include "reconstruction/labels/assignment.h"
#include "reconstruction/labels/internal/head_list.h"
#include "reconstruction/labels/internal/head_support.h"
#include "reconstruction/labels/internal/label_losses.h"
#include "reconstruction/labels/internal/sparse_blend.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr const char* kName = "panoptic-lifting";

/// Logits as scores of a field: an affine map to [0, 1] that is the same for all surfels, so
/// that the largest blended score is the largest blended logit.
renderer::SparseScores scores_of_logits(const Tensor& logits) {
  const Tensor host = logits.cpu().contiguous();
  const std::int64_t slots = host.size(1);
  const auto* value = host.data_ptr<float>();
  renderer::SparseScores scores(static_cast<std::size_t>(host.size(0)),
                                static_cast<std::size_t>(slots));
  if (host.numel() == 0) return scores;
  const float lowest = host.min().item<float>();
  const float range = std::max(host.max().item<float>() - lowest, 1e-6F);
  for (std::int64_t s = 0; s < host.size(0); ++s, value += slots) {
    const float base = *std::min_element(value, value + slots);
    std::vector<renderer::SparseScores::Entry> row;
    for (std::int64_t j = 0; j < slots; ++j) {
      if (value[j] <= base) continue;
      row.push_back({static_cast<std::uint16_t>(j), (value[j] - base) / range});
    }
    std::stable_sort(row.begin(), row.end(),
                     [](const auto& a, const auto& b) { return a.excess > b.excess; });
    scores.set(static_cast<std::size_t>(s), (base - lowest) / range, row);
  }
  return scores;
}

/// Mean over pixels of the weight times -log of the target's probability, where rows of
/// `probability` are renormalised over the classes.
Tensor cross_entropy(const Tensor& probability, const Tensor& target, const Tensor& weight) {
  const Tensor normalised = probability / probability.sum(1, true).clamp_min(1e-6);
  return negative_log_likelihood(normalised.gather(1, target.unsqueeze(1)).squeeze(1), weight);
}

class PanopticLiftingHead : public PanopticHead {
 public:
  PanopticLiftingHead(PanopticHeadInputs inputs, const PanopticTrainingConfig& config)
      : inputs_(std::move(inputs)),
        config_(config),
        device_(device_of(inputs_.cuda_device)),
        maker_(surfels(), device_),
        semantic_(logits(static_cast<std::int64_t>(inputs_.classes.size()))),
        instance_(logits(config.panoptic_lifting.slots)) {}

  std::vector<NamedLoss> step(const PanopticBatch& batch, std::int64_t iteration) override {
    const PanopticLiftingConfig& weights = config_.panoptic_lifting;
    const double progress =
        static_cast<double>(iteration) / static_cast<double>(config_.iterations);
    const BlendMatrix matrix = maker_.make(batch.weights);
    const Tensor alpha = matrix.alpha.cpu();
    const BatchTargets targets =
        make_targets(batch, alpha.data_ptr<float>(), inputs_.classes, config_);
    if (targets.labelled.empty()) return {{"total", 0.0}};
    const MaskTargets masks = mask_targets(targets, targets.labelled, device_);

    const auto leaf = [&](const AdamTensor& parameter) {
      return parameter.value().index_select(0, matrix.surfel).detach().requires_grad_(true);
    };
    const Tensor semantic_rows = leaf(semantic_), instance_rows = leaf(instance_);
    const Tensor classes =
        blend(matrix, torch::softmax(semantic_rows, 1)).index_select(0, masks.pixels);
    const Tensor label = device_tensor(targets.class_index, torch::kInt64, device_)
                             .index_select(0, masks.pixels);
    LossSum sum;
    sum.add("semantic", weights.semantic, cross_entropy(classes, label, masks.weight));
    if (!targets.masks.empty() && progress >= weights.segment_from) {
      add_segment_loss(sum, classes, masks);
    }
    if (!targets.masks.empty() && progress >= weights.instance_from) {
      add_instance_loss(sum, blend(matrix, instance_rows), targets, masks);
    }
    std::vector<NamedLoss> losses = sum.finish(iteration);
    const double rate = weights.rate * rate_factor(config_.rate, progress);
    if (semantic_rows.grad().defined()) {
      semantic_.step_rows(matrix.surfel, semantic_rows.grad(), rate);
    }
    if (instance_rows.grad().defined()) {
      instance_.step_rows(matrix.surfel, instance_rows.grad(), rate);
    }
    return losses;
  }

  [[nodiscard]] PanopticResult result() const override {
    PanopticResult result;
    renderer::PanopticField& field = result.field;
    for (const core::SceneClass& c : inputs_.classes) {
      field.class_id.push_back(c.id);
      field.class_is_thing.push_back(c.thing ? 1 : 0);
    }
    for (int slot = 1; slot <= config_.panoptic_lifting.slots; ++slot) {
      field.instance_id.push_back(static_cast<std::uint16_t>(slot));
    }
    field.classes = scores_of_probabilities();
    field.instances = scores_of_logits(instance_.value());
    return result;
  }

  void save(const std::filesystem::path& file) const override {
    StateWriter out(kName);
    semantic_.save(out, "surfel.semantic");
    instance_.save(out, "surfel.instance");
    out.write(file);
  }
  void load(const std::filesystem::path& file) override {
    const StateReader in(file, kName);
    in.expect_rows("surfel.semantic", surfels());
    semantic_.load(in, "surfel.semantic");
    instance_.load(in, "surfel.instance");
  }

 private:
  [[nodiscard]] std::int64_t surfels() const {
    return static_cast<std::int64_t>(inputs_.position_m.size());
  }
  [[nodiscard]] Tensor logits(std::int64_t size) const {
    return torch::zeros({surfels(), size},
                        torch::TensorOptions().dtype(torch::kFloat32).device(device_));
  }
  [[nodiscard]] renderer::SparseScores scores_of_probabilities() const {
    const Tensor p = torch::softmax(semantic_.value(), 1).cpu().contiguous();
    const auto classes = static_cast<std::size_t>(p.size(1));
    renderer::SparseScores scores(static_cast<std::size_t>(p.size(0)), classes);
    for (std::size_t s = 0; s < scores.size(); ++s) {
      const float* value = p.data_ptr<float>() + s * classes;
      std::vector<renderer::SparseScores::Entry> row;
      for (std::size_t c = 0; c < classes; ++c) {
        if (value[c] > 0.0F) row.push_back({static_cast<std::uint16_t>(c), value[c]});
      }
      std::stable_sort(row.begin(), row.end(),
                       [](const auto& a, const auto& b) { return a.excess > b.excess; });
      scores.set(s, 0.0F, row);
    }
    return scores;
  }

  /// A mask's pixels should agree with the class that the model itself gives the mask.
  void add_segment_loss(LossSum& sum, const Tensor& classes, const MaskTargets& masks) const {
    const Tensor mean = masks.one_hot.t().matmul(classes.detach());
    const Tensor target = mean.argmax(1);
    const Tensor inside = masks.one_hot.sum(1).gt(0.5).nonzero().squeeze(1);
    const Tensor mask_of = masks.one_hot.index_select(0, inside).argmax(1);
    sum.add("segment", config_.panoptic_lifting.segment,
            cross_entropy(classes.index_select(0, inside), target.index_select(0, mask_of),
                          masks.weight.index_select(0, inside)));
  }

  /// Masks take the slots that their pixels agree with most; masks beyond the slots are left
  /// out.
  void add_instance_loss(LossSum& sum, const Tensor& blended, const BatchTargets& targets,
                         const MaskTargets& masks) const {
    const Tensor logit = blended.index_select(0, masks.pixels);
    const auto slots = static_cast<std::size_t>(config_.panoptic_lifting.slots);
    const std::size_t count = std::min(targets.masks.size(), slots);
    const Tensor mean = masks.one_hot.t()
                            .matmul(torch::softmax(logit.detach(), 1))
                            .div(masks.one_hot.sum(0).unsqueeze(1))
                            .to(torch::kFloat64)
                            .neg()
                            .cpu()
                            .contiguous();
    const std::vector<int> slot_of =
        assign({mean.data_ptr<double>(), count * slots}, count, slots);
    std::vector<std::int64_t> target(targets.masks.size(), -1);
    std::copy(slot_of.begin(), slot_of.end(), target.begin());
    const Tensor slot =
        device_tensor(target, torch::kInt64, device_).index_select(0, masks.one_hot.argmax(1));
    const Tensor inside =
        masks.one_hot.sum(1).gt(0.5).logical_and(slot.ge(0)).nonzero().squeeze(1);
    if (inside.size(0) == 0) return;
    const Tensor log_p = torch::log_softmax(logit.index_select(0, inside), 1)
                             .gather(1, slot.index_select(0, inside).unsqueeze(1))
                             .squeeze(1);
    sum.add("instance", config_.panoptic_lifting.instance,
            -(log_p * masks.weight.index_select(0, inside)).mean());
  }

  PanopticHeadInputs inputs_;
  PanopticTrainingConfig config_;
  at::Device device_;
  BlendMatrixMaker maker_;
  AdamTensor semantic_, instance_;  ///< [surfels, classes], [surfels, slots].
};

}  // namespace

std::unique_ptr<PanopticHead> make_panoptic_lifting_head(PanopticHeadInputs inputs,
                                                         const PanopticTrainingConfig& config,
                                                         std::uint64_t) {
  return std::make_unique<PanopticLiftingHead>(std::move(inputs), config);
}

}  // namespace segsim::reconstruction::internal
