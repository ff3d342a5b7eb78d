// OpenGaussian (Wu et al., NeurIPS 2024) on surfels: features that are alike within a mask and
// different between the masks of an image, then groups of surfels with like features in two
// levels, and at last a name for each group from the masks that fit it. Read
// OpenGaussianHead::step() first; group_names.h is the last stage.
//
// Departures from the published program:
//   - its masks are SAM's, of everything. Here the region of a stuff class is a mask, too;
//   - the three stages share the iterations of one run instead of 20 000 each, at a higher
//     rate, on sampled pixels instead of whole images of random size;
//   - all coarse groups are refined at a time, not one after the other;
//   - it answers phrases with groups that look alike in CLIP's eyes. Here a group has the
//   class
//     that most of its masks have, or most of its pixels where no mask fits it; groups of a
//     thing class that lie in one mask in most of the views that show both are one object.
//     Surfels have the labels of their groups, which are blended.

#include <cmath>

#include "core/random.h"
#include "reconstruction/internal/tensors/adam.h"
#include "reconstruction/labels/internal/codebook.h"
#include "reconstruction/labels/internal/group_names.h"
#include "reconstruction/labels/internal/head_list.h"
#include "reconstruction/labels/internal/pixel_store.h"
#include "reconstruction/labels/internal/regions.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr const char* kName = "open-gaussian";
constexpr std::int64_t kFeatureSize = 6;
constexpr double kLeastRepulsion = 0.1;  ///< Of the farthest mask; the nearest has 1.
constexpr double kNearMask = 0.9;        ///< Masks that still repel when it is sharpened.
constexpr std::int64_t kGroupsAtOnce = 64;

class OpenGaussianHead : public PanopticHead {
 public:
  OpenGaussianHead(PanopticHeadInputs inputs, const PanopticTrainingConfig& config,
                   std::uint64_t seed)
      : inputs_(std::move(inputs)),
        config_(config),
        device_(device_of(inputs_.cuda_device)),
        maker_(surfels(), device_),
        place_(positions_tensor(inputs_.position_m, device_) *
               config.open_gaussian.position_weight),
        feature_(random_features(seed)),
        learnt_(feature_.value().clone()),
        codebook_(surfels(), config.open_gaussian.coarse, config.open_gaussian.fine,
                  config.open_gaussian.rounds, seed, device_),
        store_(inputs_.frames, config.open_gaussian.points, seed, device_) {}

  std::vector<NamedLoss> step(const PanopticBatch& batch, std::int64_t iteration) override {
    const double progress =
        static_cast<double>(iteration) / static_cast<double>(config_.iterations);
    const BlendMatrix matrix = maker_.make(batch.weights);
    const Tensor alpha = matrix.alpha.cpu();
    const BatchTargets targets =
        make_targets(batch, alpha.data_ptr<float>(), inputs_.classes, config_);
    if (targets.labelled.empty()) return {{"total", 0.0}};
    store_.keep(batch, matrix, targets, targets.labelled);
    assign_groups(iteration, progress);
    const Regions regions =
        regions_of(targets, inputs_.classes, config_.query.min_mask_pixels, device_);
    if (regions.count() == 0) return {{"total", 0.0}};

    const Tensor rows =
        feature_.value().index_select(0, matrix.surfel).detach().requires_grad_(true);
    LossSum sum;
    if (codebook_.level() == Codebook::Level::kNone) {
      add_contrast_losses(sum, at(regions, matrix, rows), regions, progress);
    } else {
      add_codebook_loss(sum, matrix, rows, regions);
    }
    std::vector<NamedLoss> losses = sum.finish(iteration);
    if (rows.grad().defined()) {
      feature_.step_rows(matrix.surfel, rows.grad(),
                         config_.open_gaussian.rate * rate_factor(config_.rate, progress));
    }
    return losses;
  }

  [[nodiscard]] PanopticResult result() const override;

  void save(const std::filesystem::path& file) const override {
    StateWriter out(kName);
    feature_.save(out, "surfel.feature");
    out.put("surfel.learnt", learnt_);
    codebook_.save(out);
    store_.save(out);
    out.write(file);
  }
  void load(const std::filesystem::path& file) override {
    const StateReader in(file, kName);
    in.expect_rows("surfel.feature", surfels());
    in.expect_rows("surfel.learnt", surfels());
    feature_.load(in, "surfel.feature");
    learnt_ = in.take("surfel.learnt", learnt_);
    codebook_.load(in);
    store_.load(in);
  }

 private:
  [[nodiscard]] std::int64_t surfels() const {
    return static_cast<std::int64_t>(inputs_.position_m.size());
  }
  [[nodiscard]] Tensor random_features(std::uint64_t seed) const {
    core::RandomStream random(seed, "open_gaussian_features");
    std::vector<float> values(static_cast<std::size_t>(surfels() * kFeatureSize));
    for (float& value : values) value = static_cast<float>(random.uniform());
    return device_tensor(values, torch::kFloat32, device_).view({-1, kFeatureSize});
  }

  /// The stages: features are learnt, then frozen as the aim of the coarse groups, whose
  /// surfels stay together when fine groups follow.
  void assign_groups(std::int64_t iteration, double progress) {
    const OpenGaussianConfig& open = config_.open_gaussian;
    if (progress < open.coarse_from) return;
    const auto due = [&](double every) {
      const double interval = every * static_cast<double>(config_.iterations);
      return iteration % std::max<std::int64_t>(1, std::llround(interval)) == 0;
    };
    const Codebook::Level level = codebook_.level();
    if (level == Codebook::Level::kNone) learnt_ = feature_.value().clone();
    if (level == Codebook::Level::kNone ||
        (progress < open.fine_from && due(open.coarse_every))) {
      codebook_.assign_coarse(feature_.value(), place_);
    }
    if (progress >= open.fine_from &&
        (codebook_.level() != Codebook::Level::kFine || due(open.fine_every))) {
      codebook_.assign_fine(feature_.value());
    }
  }

  /// Rendered features at the pixels of the regions, in the scale of the published losses.
  [[nodiscard]] static Tensor at(const Regions& regions, const BlendMatrix& matrix,
                                 const Tensor& rows) {
    return (blend(matrix, rows).index_select(0, regions.pixel) + 1.0) / 2.0;
  }

  /// Pixels are drawn to the mean of their region, and the means repel each other: the nearer
  /// the more, and in the end only the nearest.
  void add_contrast_losses(LossSum& sum, const Tensor& feature, const Regions& regions,
                           double progress) const {
    const OpenGaussianConfig& open = config_.open_gaussian;
    const Tensor mean = regions.means(feature);
    // The floor keeps the derivative of the root finite.
    const Tensor distance =
        ((feature - mean.index_select(0, regions.region)).pow(2).sum(1) + 1e-12).sqrt();
    sum.add("cohesion", open.cohesion, regions.means(distance.unsqueeze(1)).mean());
    if (regions.count() < 2) return;
    const Tensor distance2 = (mean.unsqueeze(0) - mean.unsqueeze(1)).pow(2).sum(2);
    const Tensor self = torch::eye(regions.count(), mean.options());
    // 0 for the region itself, 1 for the farthest, ... count - 1 for the nearest.
    const Tensor rank = (distance2.detach() + 1e9 * self)
                            .argsort(/*stable=*/true, 1, /*descending=*/true)
                            .argsort(/*stable=*/true, 1, /*descending=*/false)
                            .to(torch::kFloat32);
    const auto steps = static_cast<double>(std::max<std::int64_t>(regions.count() - 2, 1));
    Tensor weight = kLeastRepulsion + (1.0 - kLeastRepulsion) * (rank - 1.0) / steps;
    if (regions.count() == 2) weight = torch::ones_like(weight);
    if (progress >= open.sharpen_from) {
      weight = torch::where(weight.lt(kNearMask), torch::full_like(weight, kLeastRepulsion),
                            weight);
    }
    const auto pairs = static_cast<double>(regions.count() * (regions.count() - 1));
    sum.add("separation", open.separation,
            ((1.0 - self) * weight / (1.0 + distance2)).sum() / pairs);
  }

  /// Rendered means of groups should be what the region looked like after the first stage. The
  /// derivative passes through the means to the surfels' own features.
  void add_codebook_loss(LossSum& sum, const BlendMatrix& matrix, const Tensor& rows,
                         const Regions& regions) const {
    const OpenGaussianConfig& open = config_.open_gaussian;
    const Tensor learnt = at(regions, matrix, learnt_.index_select(0, matrix.surfel));
    const Tensor mean = regions.means(learnt);
    const Tensor variance =
        regions.means((learnt - mean.index_select(0, regions.region)).pow(2)).mean(1);
    const Tensor size = regions.size.squeeze(1);
    const Tensor teaches = variance.le(open.max_variance)
                               .logical_or(size.gt(open.large_mask * size.max()))
                               .to(torch::kFloat32)
                               .index_select(0, regions.region);
    const Tensor of_group =
        codebook_.means(feature_.value())
            .index_select(0, codebook_.group().index_select(0, matrix.surfel));
    const Tensor quantised = rows + (of_group - rows).detach();
    const Tensor error = at(regions, matrix, quantised) - mean.index_select(0, regions.region);
    const bool fine = codebook_.level() == Codebook::Level::kFine;
    const Tensor each = fine ? error.pow(2).mean(1) : error.abs().mean(1);
    sum.add(fine ? "fine" : "coarse", 1.0,
            (each * teaches).sum() / teaches.sum().clamp_min(1.0));
  }

  /// [kept pixels]: the group with the most weight.
  [[nodiscard]] std::vector<std::int64_t> groups_of_pixels() const;
  [[nodiscard]] std::vector<GroupName> names() const;

  PanopticHeadInputs inputs_;
  PanopticTrainingConfig config_;
  at::Device device_;
  BlendMatrixMaker maker_;
  Tensor place_;        ///< [surfels, 3], weighed.
  AdamTensor feature_;  ///< [surfels, 6].
  Tensor learnt_;       ///< Those at the end of the first stage.
  Codebook codebook_;
  PixelStore store_;
};

template <class Value>
std::vector<Value> host_values(const Tensor& values) {
  const Tensor host = values.cpu().contiguous();
  const auto* first = host.data_ptr<Value>();
  return {first, first + host.numel()};
}

std::vector<std::int64_t> OpenGaussianHead::groups_of_pixels() const {
  Tensor best, most;
  for (std::int64_t first = 0; first < codebook_.size(); first += kGroupsAtOnce) {
    const Tensor groups = torch::arange(
        first, std::min(first + kGroupsAtOnce, codebook_.size()), codebook_.group().options());
    const Tensor inside =
        codebook_.group().unsqueeze(1).eq(groups.unsqueeze(0)).to(torch::kFloat32);
    const auto [weight, at] = store_.blend(inside).max(1);
    if (!most.defined()) {
      most = weight, best = at;
      continue;
    }
    best = torch::where(weight.gt(most), at + first, best);
    most = torch::maximum(weight, most);
  }
  return host_values<std::int64_t>(best);
}

std::vector<GroupName> OpenGaussianHead::names() const {
  const GroupedPixels pixels{store_.frame(), groups_of_pixels(), store_.class_index(),
                             store_.mask_id(),
                             host_values<float>((store_.blend(feature_.value()) + 1.0) / 2.0)};
  const OpenGaussianConfig& open = config_.open_gaussian;
  return name_groups(pixels,
                     host_values<float>((codebook_.means(feature_.value()) + 1.0) / 2.0),
                     static_cast<std::size_t>(codebook_.size()), inputs_.classes,
                     {.min_score = open.min_score, .min_together = open.min_together});
}

/// Until there are groups nothing has a label.
PanopticResult OpenGaussianHead::result() const {
  const at::NoGradGuard no_grad;
  const auto count = static_cast<std::size_t>(surfels());
  PanopticResult result;
  renderer::PanopticField& field = result.field;
  for (const core::SceneClass& c : inputs_.classes) {
    field.class_id.push_back(c.id);
    field.class_is_thing.push_back(c.thing ? 1 : 0);
  }
  field.classes = renderer::SparseScores(count, 1);
  field.instances = renderer::SparseScores(count, 1);
  if (codebook_.level() == Codebook::Level::kNone || store_.size() == 0) return result;
  const std::vector<GroupName> name_of = names();
  for (const GroupName& name : name_of) {
    if (name.object == 0) continue;
    const auto object = static_cast<std::size_t>(name.object);
    if (object > field.instance_id.size()) {
      field.instance_id.resize(object);
      field.instance_class.resize(object);
    }
    field.instance_id[object - 1] = static_cast<std::uint16_t>(object);
    field.instance_class[object - 1] =
        inputs_.classes[static_cast<std::size_t>(name.class_index)].id;
  }
  const std::vector<std::int64_t> group = host_values<std::int64_t>(codebook_.group());
  using Entry = renderer::SparseScores::Entry;
  for (std::size_t s = 0; s < count; ++s) {
    const GroupName& name = name_of[static_cast<std::size_t>(group[s])];
    if (name.class_index < 0) continue;
    const Entry of_class{static_cast<std::uint16_t>(name.class_index), 1.0F};
    field.classes.set(s, 0.0F, {&of_class, 1});
    if (name.object == 0) continue;
    const Entry of_object{static_cast<std::uint16_t>(name.object - 1), 1.0F};
    field.instances.set(s, 0.0F, {&of_object, 1});
  }
  return result;
}

}  // namespace

constinit const HeadMaker kMakeOpenGaussian = make_head<OpenGaussianHead>;

}  // namespace segsim::reconstruction::internal
