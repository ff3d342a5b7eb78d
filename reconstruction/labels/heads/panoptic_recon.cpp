// PanopticRecon (Yu et al., IROS 2024) on surfels: before training, a graph of patches of the
// surface tells which masks of different views show one object (guidance_graph.h); then
// classes and instances are learned as two softmax fields from labels that agree in all views.
//
// Departures from what is published (an abstract and a description; there is no program):
//   - patches are of surfels instead of a mesh, and every number of the graph is ours;
//   - fields are logits on surfels instead of volumes with networks;
//   - features of DINOv2, which fill in what has no mask, are not here: pixels without a label
//     say nothing, nor do masks of no object;
//   - masks of an object are taught the class of the object, as published; an instance has it
//     when it is drawn, too.

#include "core/check.h"
#include "reconstruction/internal/tensors/adam.h"
#include "reconstruction/labels/internal/class_logits.h"
#include "reconstruction/labels/internal/head_list.h"
#include "reconstruction/labels/internal/label_losses.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr const char* kName = "panoptic-recon";

class PanopticReconHead : public PanopticHead {
 public:
  PanopticReconHead(PanopticHeadInputs inputs, const PanopticTrainingConfig& config,
                    std::uint64_t)
      : inputs_(std::move(inputs)),
        config_(config),
        device_(device_of(inputs_.cuda_device)),
        maker_(surfels(), device_),
        semantic_(surfels(), static_cast<std::int64_t>(inputs_.classes.size()), device_),
        instance_(
            torch::zeros({surfels(), 1 + objects()},
                         torch::TensorOptions().dtype(torch::kFloat32).device(device_))) {
    for (std::size_t c = 0; c < inputs_.classes.size(); ++c) {
      index_of_class_[inputs_.classes[c].id] = static_cast<std::int64_t>(c);
    }
    for (const std::uint16_t id : inputs_.object_class) {
      SEGSIM_CHECK(index_of_class_.contains(id), "class " + std::to_string(id));
    }
  }

  std::vector<NamedLoss> step(const PanopticBatch& batch, std::int64_t iteration) override {
    const double progress =
        static_cast<double>(iteration) / static_cast<double>(config_.iterations);
    const BlendMatrix matrix = maker_.make(batch.weights);
    const Tensor alpha = matrix.alpha.cpu();
    BatchTargets targets =
        make_targets(batch, alpha.data_ptr<float>(), inputs_.classes, config_);
    const std::vector<std::int64_t> object_of_pixel = align(batch, targets);
    if (targets.labelled.empty()) return {{"total", 0.0}};
    const MaskTargets masks = mask_targets(targets, targets.labelled, device_);

    const ClassLogits::Rendered classes = semantic_.render(matrix, masks);
    const Tensor rows =
        instance_.value().index_select(0, matrix.surfel).detach().requires_grad_(true);
    LossSum sum;
    semantic_.add_class_loss(sum, config_.panoptic_recon.semantic, classes, targets, masks);
    const Tensor probability =
        blend(matrix, torch::softmax(rows, 1))
            .index_select(0, masks.pixels)
            .gather(1, device_tensor(object_of_pixel, torch::kInt64, device_).unsqueeze(1))
            .squeeze(1);
    sum.add("instance", config_.panoptic_recon.instance,
            negative_log_likelihood(probability, masks.weight));
    std::vector<NamedLoss> losses = sum.finish(iteration);
    const double rate = config_.panoptic_recon.rate * rate_factor(config_.rate, progress);
    semantic_.step(matrix, classes, rate);
    if (rows.grad().defined()) instance_.step_rows(matrix.surfel, rows.grad(), rate);
    return losses;
  }

  [[nodiscard]] PanopticResult result() const override {
    const at::NoGradGuard no_grad;
    PanopticResult result;
    result.field = field_of_classes(inputs_.classes, semantic_.probabilities());
    result.field.instances = scores_of_probabilities(torch::softmax(instance_.value(), 1));
    result.field.instance_id = {0};
    result.field.instance_class = {0};
    for (const std::uint16_t class_id : inputs_.object_class) {
      result.field.instance_id.push_back(
          static_cast<std::uint16_t>(result.field.instance_id.size()));
      result.field.instance_class.push_back(class_id);
    }
    if (inputs_.object_class.empty()) {  // Else all things were void.
      result.field.instance_class.clear();
    }
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
  [[nodiscard]] std::int64_t objects() const {
    return static_cast<std::int64_t>(inputs_.object_class.size());
  }

  /// Gives pixels the class of their object, and leaves out those of things without one.
  /// @return  Object of each pixel that is left, 0 = stuff.
  [[nodiscard]] std::vector<std::int64_t> align(const PanopticBatch& batch,
                                                BatchTargets& targets) const {
    const auto frame = static_cast<std::size_t>(batch.frame);
    std::vector<std::int64_t> kept, object_of_pixel;
    for (const std::int64_t pixel : targets.labelled) {
      const auto p = static_cast<std::size_t>(pixel);
      std::int64_t& c = targets.class_index[p];
      std::int64_t object = 0;
      if (inputs_.classes[static_cast<std::size_t>(c)].thing) {
        if (frame >= inputs_.object_of_mask.size()) continue;
        const auto found = inputs_.object_of_mask[frame].find(batch.instance[p]);
        if (found == inputs_.object_of_mask[frame].end()) continue;
        object = found->second;
        c = index_of_class_.at(inputs_.object_class[static_cast<std::size_t>(object - 1)]);
      }
      kept.push_back(pixel);
      object_of_pixel.push_back(object);
    }
    targets.labelled = std::move(kept);
    return object_of_pixel;
  }

  PanopticHeadInputs inputs_;
  PanopticTrainingConfig config_;
  at::Device device_;
  BlendMatrixMaker maker_;
  ClassLogits semantic_;
  AdamTensor instance_;  ///< [surfels, 1 + objects]: "none" first.
  std::map<std::uint16_t, std::int64_t> index_of_class_;
};

}  // namespace

constinit const HeadMaker kMakePanopticRecon = make_head<PanopticReconHead>;

}  // namespace segsim::reconstruction::internal
