// Panoptic Lifting (Siddiqui et al., CVPR 2023) on surfels: every surfel has logits of the
// classes and of a fixed number of instance slots, instead of the original's networks on
// positions. Losses and stages follow the published code; the segment loss takes the masks of
// the frame as its segments.

#include "reconstruction/internal/tensors/adam.h"
#include "reconstruction/labels/internal/class_logits.h"
#include "reconstruction/labels/internal/head_list.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr const char* kName = "panoptic-lifting";

class PanopticLiftingHead : public PanopticHead {
 public:
  PanopticLiftingHead(PanopticHeadInputs inputs, const PanopticTrainingConfig& config,
                      std::uint64_t)
      : inputs_(std::move(inputs)),
        config_(config),
        device_(device_of(inputs_.cuda_device)),
        maker_(surfels(), device_),
        semantic_(surfels(), static_cast<std::int64_t>(inputs_.classes.size()), device_),
        instance_(
            torch::zeros({surfels(), config.panoptic_lifting.slots},
                         torch::TensorOptions().dtype(torch::kFloat32).device(device_))) {}

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

    const ClassLogits::Rendered classes = semantic_.render(matrix, masks);
    const Tensor instance_rows =
        instance_.value().index_select(0, matrix.surfel).detach().requires_grad_(true);
    LossSum sum;
    semantic_.add_class_loss(sum, weights.semantic, classes, targets, masks);
    if (progress >= weights.segment_from) {
      semantic_.add_segment_loss(sum, weights.segment, classes, masks);
    }
    if (!targets.masks.empty() && progress >= weights.instance_from) {
      add_instance_loss(sum, blend(matrix, instance_rows), masks);
    }
    std::vector<NamedLoss> losses = sum.finish(iteration);
    const double rate = weights.rate * rate_factor(config_.rate, progress);
    semantic_.step(matrix, classes, rate);
    if (instance_rows.grad().defined()) {
      instance_.step_rows(matrix.surfel, instance_rows.grad(), rate);
    }
    return losses;
  }

  [[nodiscard]] PanopticResult result() const override {
    PanopticResult result;
    renderer::PanopticField& field = result.field;
    field = field_of_classes(inputs_.classes, semantic_.probabilities());
    for (int slot = 1; slot <= config_.panoptic_lifting.slots; ++slot) {
      field.instance_id.push_back(static_cast<std::uint16_t>(slot));
    }
    field.instances = scores_of_logits(instance_.value());
    return result;
  }

  void save(const std::filesystem::path& file) const override {
    StateWriter out(kName);
    semantic_.save(out);
    instance_.save(out, "surfel.instance");
    out.write(file);
  }
  void load(const std::filesystem::path& file) override {
    const StateReader in(file, kName);
    semantic_.load(in);
    instance_.load(in, "surfel.instance");
  }

 private:
  [[nodiscard]] std::int64_t surfels() const {
    return static_cast<std::int64_t>(inputs_.position_m.size());
  }

  /// Masks take the slots that their pixels agree with most; masks beyond the slots are left
  /// out.
  void add_instance_loss(LossSum& sum, const Tensor& blended, const MaskTargets& masks) const {
    const Tensor logit = blended.index_select(0, masks.pixels);
    const std::vector<std::int64_t> target =
        assign_slots(torch::softmax(logit.detach(), 1), masks);
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
  ClassLogits semantic_;
  AdamTensor instance_;  ///< [surfels, slots].
};

}  // namespace

constinit const HeadMaker kMakePanopticLifting = make_head<PanopticLiftingHead>;

}  // namespace segsim::reconstruction::internal
