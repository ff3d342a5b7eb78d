// Gaussian Grouping (Ye et al., ECCV 2024) on surfels: every surfel has an identity of 16
// numbers, a linear layer makes ids of rendered identities, and surfels near one another are
// drawn to the same id. The ids that it is taught hold in all views, or, as an option, are
// assigned anew in every step.
//
// Departures from the published program:
//   - its tracker is not here: mask_association.h tells which masks of different views show
//   one
//     object, from the same masks as every head has. Masks of no object are taught "none" (id
//     0), as masks that the tracker drops are;
//   - surfels are frozen, so identities do not move them;
//   - its masks cover stuff, too, and are named by a detector on demand. Here stuff is taught
//     "none", classes are logits on surfels with the losses of Panoptic Lifting, and an id has
//     the class that most pixels of its masks have;
//   - identities begin at zero instead of at random, with higher rates (baseline_config.h);
//   - a surfel is not among its own neighbours.

#include <cmath>

#include "core/random.h"
#include "reconstruction/labels/internal/class_logits.h"
#include "reconstruction/labels/internal/head_list.h"
#include "reconstruction/labels/internal/nearest_surfels.h"
#include "reconstruction/labels/internal/query_set.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr const char* kName = "gaussian-grouping";
constexpr std::int64_t kIdentitySize = 16;

/// Surfels whose ids should be alike, as rows of the step's leaf.
struct Neighbourhoods {
  Tensor surfel;     ///< [n] int64, of the cloud.
  Tensor neighbour;  ///< [n k] int64, of the cloud.
};

class GaussianGroupingHead : public PanopticHead {
 public:
  GaussianGroupingHead(PanopticHeadInputs inputs, const PanopticTrainingConfig& config,
                       std::uint64_t seed)
      : inputs_(std::move(inputs)),
        config_(config),
        seed_(seed),
        device_(device_of(inputs_.cuda_device)),
        maker_(surfels(), device_),
        nearest_(inputs_.position_m),
        semantic_(surfels(), static_cast<std::int64_t>(inputs_.classes.size()), device_),
        identity_(torch::zeros({surfels(), kIdentitySize}, options(torch::kFloat32))),
        classifier_weight_(
            linear_weight(id_count(), kIdentitySize, seed, "identity_classifier", device_)),
        classifier_bias_(torch::zeros({id_count()}, options(torch::kFloat32))),
        votes_(torch::zeros({id_count(), static_cast<std::int64_t>(inputs_.classes.size())},
                            options(torch::kInt64))) {}

  std::vector<NamedLoss> step(const PanopticBatch& batch, std::int64_t iteration) override {
    const GaussianGroupingConfig& grouping = config_.gaussian_grouping;
    const PanopticLiftingConfig& lifting = config_.panoptic_lifting;
    const double progress =
        static_cast<double>(iteration) / static_cast<double>(config_.iterations);
    const BlendMatrix matrix = maker_.make(batch.weights);
    const Tensor alpha = matrix.alpha.cpu();
    const BatchTargets targets =
        make_targets(batch, alpha.data_ptr<float>(), inputs_.classes, config_);
    if (targets.labelled.empty()) return {{"total", 0.0}};
    const MaskTargets masks = mask_targets(targets, targets.labelled, device_);

    // One leaf for what the batch sees and what smoothness compares: one step of Adam.
    const bool smooths =
        grouping.smoothness > 0.0 && iteration % grouping.smoothness_every == 0;
    const Neighbourhoods near = smooths ? draw_neighbourhoods(iteration) : Neighbourhoods{};
    const auto [rows, place] = smooths ? unite({matrix.surfel, near.surfel, near.neighbour})
                                       : std::pair{matrix.surfel, Tensor()};
    const Tensor identity = identity_.value().index_select(0, rows).requires_grad_(true);
    const Tensor weight = classifier_weight_.value().detach().requires_grad_(true);
    const Tensor bias = classifier_bias_.value().detach().requires_grad_(true);
    const ClassLogits::Rendered classes = semantic_.render(matrix, masks);

    LossSum sum;
    semantic_.add_class_loss(sum, lifting.semantic, classes, targets, masks);
    if (progress >= lifting.segment_from) {
      semantic_.add_segment_loss(sum, lifting.segment, classes, masks);
    }
    const Tensor seen =
        smooths ? identity.index_select(0, place.slice(0, 0, matrix.surfels())) : identity;
    add_identity_loss(sum, torch::addmm(bias, blend(matrix, seen), weight.t()), batch,
                      targets);
    if (smooths) {
      add_smoothness_loss(sum,
                          torch::addmm(bias, identity, weight.t())
                              .index_select(0, place.slice(0, matrix.surfels())),
                          near.surfel.size(0));
    }
    std::vector<NamedLoss> losses = sum.finish(iteration);
    const double factor = rate_factor(config_.rate, progress);
    semantic_.step(matrix, classes, lifting.rate * factor);
    if (identity.grad().defined()) {
      identity_.step_rows(rows, identity.grad(), grouping.rate * factor);
      classifier_weight_.step(weight.grad(), grouping.classifier_rate * factor);
      classifier_bias_.step(bias.grad(), grouping.classifier_rate * factor);
    }
    return losses;
  }

  [[nodiscard]] PanopticResult result() const override;

  void save(const std::filesystem::path& file) const override {
    StateWriter out(kName);
    semantic_.save(out);
    identity_.save(out, "surfel.identity");
    classifier_weight_.save(out, "classifier.weight");
    classifier_bias_.save(out, "classifier.bias");
    out.put("votes", votes_);
    out.write(file);
  }
  void load(const std::filesystem::path& file) override {
    const StateReader in(file, kName);
    in.expect_rows("classifier.weight", id_count());
    semantic_.load(in);
    identity_.load(in, "surfel.identity");
    classifier_weight_.load(in, "classifier.weight");
    classifier_bias_.load(in, "classifier.bias");
    votes_ = in.take("votes", votes_);
  }

 private:
  [[nodiscard]] std::int64_t surfels() const {
    return static_cast<std::int64_t>(inputs_.position_m.size());
  }
  [[nodiscard]] at::TensorOptions options(at::ScalarType type) const {
    return torch::TensorOptions().dtype(type).device(device_);
  }
  [[nodiscard]] bool associated() const {
    return config_.gaussian_grouping.identities == IdentitySource::kAssociated;
  }
  /// "None" and, of ids that hold in all views, those there are: the others would never win.
  [[nodiscard]] std::int64_t id_count() const {
    std::int64_t most = config_.gaussian_grouping.ids - 1;
    if (associated()) {
      std::int64_t objects = 0;
      for (const auto& of_frame : inputs_.object_of_mask) {
        for (const auto& [mask, object] : of_frame) {
          objects = std::max<std::int64_t>(objects, object);
        }
      }
      most = std::min(most, objects);
    }
    return 1 + most;
  }

  [[nodiscard]] Neighbourhoods draw_neighbourhoods(std::int64_t iteration) const {
    core::RandomStream random(seed_, "identity_smoothness",
                              static_cast<std::uint64_t>(iteration));
    std::vector<std::int64_t> surfel, neighbour;
    const auto wanted = static_cast<std::size_t>(config_.gaussian_grouping.neighbours);
    for (int i = 0; i < config_.gaussian_grouping.smoothness_surfels; ++i) {
      const auto s =
          static_cast<std::int64_t>(random.index(static_cast<std::uint32_t>(surfels())));
      const std::vector<std::int64_t> near =
          nearest_.nearest(s, config_.gaussian_grouping.neighbours);
      if (near.size() < wanted) continue;
      surfel.push_back(s);
      neighbour.insert(neighbour.end(), near.begin(), near.end());
    }
    return {device_tensor(surfel, torch::kInt64, device_),
            device_tensor(neighbour, torch::kInt64, device_)};
  }

  /// All surfels of the lists, each once, and where each entry of the lists is among them.
  [[nodiscard]] static std::pair<Tensor, Tensor> unite(const std::vector<Tensor>& lists) {
    auto [rows, place, counts] = at::_unique2(torch::cat(lists), true, true);
    return {rows, place};
  }

  /// Identity of each mask of the batch, -1 = not taught.
  [[nodiscard]] std::vector<std::int64_t> identities(const Tensor& logit,
                                                     const PanopticBatch& batch,
                                                     const BatchTargets& targets,
                                                     const MaskTargets& masks) const {
    if (targets.masks.empty()) return {};
    std::vector<std::int64_t> id;
    if (!associated()) {
      id = assign_slots(torch::softmax(logit.detach(), 1).slice(1, 1), masks);
      for (std::int64_t& slot : id) slot = slot < 0 ? -1 : slot + 1;
      return id;
    }
    const auto frame = static_cast<std::size_t>(batch.frame);
    for (const TargetMask& mask : targets.masks) {
      id.push_back(0);
      if (frame >= inputs_.object_of_mask.size()) continue;
      const auto found = inputs_.object_of_mask[frame].find(mask.id);
      if (found != inputs_.object_of_mask[frame].end() && found->second < id_count()) {
        id.back() = found->second;
      }
    }
    return id;
  }

  void add_identity_loss(LossSum& sum, const Tensor& logits, const PanopticBatch& batch,
                         const BatchTargets& targets) {
    const bool negative = config_.void_policy == VoidPolicy::kNegative;
    const MaskTargets masks =
        mask_targets(targets, negative ? targets.valid : targets.labelled, device_);
    const Tensor at_masks = logits.index_select(0, masks.pixels);
    const std::vector<std::int64_t> id_of = identities(at_masks, batch, targets, masks);
    std::vector<std::int64_t> place, target, vote;
    const auto class_count = static_cast<std::int64_t>(inputs_.classes.size());
    std::int64_t at = 0;
    for (const std::int64_t pixel : negative ? targets.valid : targets.labelled) {
      const auto p = static_cast<std::size_t>(pixel);
      const std::int64_t mask = targets.mask_index[p], c = targets.class_index[p];
      const std::int64_t here = at++;
      const bool stray =
          mask < 0 && c >= 0 && inputs_.classes[static_cast<std::size_t>(c)].thing;
      const std::int64_t id = mask < 0 ? 0 : id_of[static_cast<std::size_t>(mask)];
      if (stray || id < 0) continue;
      place.push_back(here);
      target.push_back(id);
      if (id > 0) vote.push_back(id * class_count + c);
    }
    votes_ += torch::bincount(device_tensor(vote, torch::kInt64, device_), {}, votes_.numel())
                  .view(votes_.sizes());
    if (place.empty()) return;
    const Tensor taught = device_tensor(place, torch::kInt64, device_);
    const Tensor log_p =
        torch::log_softmax(at_masks.index_select(0, taught), 1)
            .gather(1, device_tensor(target, torch::kInt64, device_).unsqueeze(1))
            .squeeze(1);
    const GaussianGroupingConfig& grouping = config_.gaussian_grouping;
    sum.add("identity", grouping.identity / std::log(static_cast<double>(grouping.ids)),
            -(log_p * masks.weight.index_select(0, taught)).mean());
  }

  /// Kullback-Leibler divergence of surfels' ids from those of their neighbours.
  /// @param logits  [n + n k, ids]: of the surfels, then of their neighbours.
  void add_smoothness_loss(LossSum& sum, const Tensor& logits, std::int64_t count) const {
    if (count == 0) return;
    const Tensor log_p = torch::log_softmax(logits, 1);
    const Tensor own = log_p.slice(0, 0, count).unsqueeze(1);
    const Tensor other = log_p.slice(0, count).view({count, -1, log_p.size(1)});
    const GaussianGroupingConfig& grouping = config_.gaussian_grouping;
    sum.add("smoothness", grouping.smoothness / static_cast<double>(grouping.ids),
            (own.exp() * (own - other)).sum(2).mean());
  }

  PanopticHeadInputs inputs_;
  PanopticTrainingConfig config_;
  std::uint64_t seed_;
  at::Device device_;
  BlendMatrixMaker maker_;
  NearestSurfels nearest_;
  ClassLogits semantic_;
  AdamTensor identity_;  ///< [surfels, 16].
  AdamTensor classifier_weight_, classifier_bias_;
  Tensor votes_;  ///< [ids, classes]: pixels that were taught an id, by class.
};

/// Ids that were never taught are left out.
PanopticResult GaussianGroupingHead::result() const {
  const at::NoGradGuard no_grad;
  PanopticResult result;
  renderer::PanopticField& field = result.field;
  field = field_of_classes(inputs_.classes, semantic_.probabilities());
  const Tensor pixels = votes_.sum(1).cpu(), class_of = votes_.argmax(1).cpu();
  std::vector<std::int64_t> used;
  for (std::int64_t id = 0; id < pixels.size(0); ++id) {
    if (id > 0 && pixels.data_ptr<std::int64_t>()[id] == 0) continue;
    used.push_back(id);
    field.instance_id.push_back(static_cast<std::uint16_t>(id));
    const auto c = static_cast<std::size_t>(class_of.data_ptr<std::int64_t>()[id]);
    field.instance_class.push_back(id == 0 ? std::uint16_t{0} : inputs_.classes[c].id);
  }
  if (used.size() == 1) field.instance_class.clear();  // Else all things were void.
  const Tensor rows = device_tensor(used, torch::kInt64, device_);
  field.instances = scores_of_logits(
      torch::addmm(classifier_bias_.value().index_select(0, rows), identity_.value(),
                   classifier_weight_.value().index_select(0, rows).t()));
  return result;
}

}  // namespace

constinit const HeadMaker kMakeGaussianGrouping = make_head<GaussianGroupingHead>;

}  // namespace segsim::reconstruction::internal
