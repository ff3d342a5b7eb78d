// Panoptic Vision-Language Feature Fields (PVLFF; Chen et al., RA-L 2024) on surfels: a
// feature of what things are, taught by distillation, and one of which instance they are,
// taught by contrast within an image. Clusters of the second are the segments of the scene,
// stuff included, and each is named by the mean of the first over its pixels.
//
// Departures from the published program:
//   - LSeg's language features need weights that are not here. The classes of the masks, one
//     number each, stand in for them, with the same loss; a class is the largest number
//     instead of the nearest phrase;
//   - its masks are SAM's, of everything, and may overlap. Here they are the masks of things
//     and the regions of stuff classes, which do not;
//   - features are parameters of surfels instead of a hash grid with networks, at higher
//     rates, and more groups of pixels are compared in a step. As such networks' do, instance
//     features begin smooth in place (waves of random direction, and noise): the surfels of an
//     object, which views show in part, have something in common before any mask has said so.
//     From noise alone short trainings find no object in a flat;
//   - the centre of a mask follows its pixels whenever its image comes, instead of every
//     thousand steps;
//   - fewer pixels are clustered, and the centre of a cluster is the mean of its points by
//     their density instead of that of its densest ones.

#include <map>
#include <numbers>

#include "core/random.h"
#include "reconstruction/internal/tensors/adam.h"
#include "reconstruction/labels/internal/class_logits.h"
#include "reconstruction/labels/internal/density_clusters.h"
#include "reconstruction/labels/internal/head_list.h"
#include "reconstruction/labels/internal/pixel_store.h"
#include "reconstruction/labels/internal/regions.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr const char* kName = "pvlff";
constexpr std::int64_t kInstanceSize = 8;
constexpr double kWaveLength_m = 6.0;  ///< Of instance features at first ...
constexpr double kWaveHeight = 0.5;    ///< ... beside noise.

Tensor normalised(const Tensor& rows) {
  return rows / (rows.pow(2).sum(1, true) + 1e-12).sqrt();
}

/// Pixels to compare: an anchor, one of its region, and others of other regions.
struct Groups {
  Tensor anchor, positive;  ///< [groups] int64, rows of the batch.
  Tensor negative;          ///< [groups * negatives] int64.
  Tensor region;            ///< [groups] int64.
};

class PvlffHead : public PanopticHead {
 public:
  PvlffHead(PanopticHeadInputs inputs, const PanopticTrainingConfig& config,
            std::uint64_t seed)
      : inputs_(std::move(inputs)),
        config_(config),
        seed_(seed),
        device_(device_of(inputs_.cuda_device)),
        maker_(surfels(), device_),
        language_(torch::zeros({surfels(), static_cast<std::int64_t>(inputs_.classes.size())},
                               torch::TensorOptions().dtype(torch::kFloat32).device(device_))),
        instance_(first_features()),
        store_(inputs_.frames, config.pvlff.clustering.points, seed, device_) {}

  std::vector<NamedLoss> step(const PanopticBatch& batch, std::int64_t iteration) override {
    const PvlffConfig& pvlff = config_.pvlff;
    const double progress =
        static_cast<double>(iteration) / static_cast<double>(config_.iterations);
    const BlendMatrix matrix = maker_.make(batch.weights);
    const Tensor alpha = matrix.alpha.cpu();
    const BatchTargets targets =
        make_targets(batch, alpha.data_ptr<float>(), inputs_.classes, config_);
    if (targets.labelled.empty()) return {{"total", 0.0}};
    store_.keep(batch, matrix, targets, targets.labelled);
    const Regions regions =
        regions_of(targets, inputs_.classes, config_.query.min_mask_pixels, device_);

    const auto leaf = [&](const AdamTensor& parameter) {
      return parameter.value().index_select(0, matrix.surfel).detach().requires_grad_(true);
    };
    const Tensor language_rows = leaf(language_), instance_rows = leaf(instance_);
    LossSum sum;
    add_language_loss(sum, blend(matrix, language_rows), targets);
    if (regions.count() >= 2) {
      add_instance_losses(sum, normalised(blend(matrix, instance_rows)), regions, batch.frame,
                          iteration);
    }
    std::vector<NamedLoss> losses = sum.finish(iteration);
    const double rate = pvlff.rate * rate_factor(config_.rate, progress);
    if (language_rows.grad().defined()) {
      language_.step_rows(matrix.surfel, language_rows.grad(), rate);
    }
    if (instance_rows.grad().defined()) {
      instance_.step_rows(matrix.surfel, instance_rows.grad(), rate);
    }
    return losses;
  }

  [[nodiscard]] PanopticResult result() const override;
  void save(const std::filesystem::path& file) const override;
  void load(const std::filesystem::path& file) override;

 private:
  using MaskKey = std::pair<std::int64_t, std::int64_t>;  ///< Frame, Regions::key.

  [[nodiscard]] std::int64_t surfels() const {
    return static_cast<std::int64_t>(inputs_.position_m.size());
  }
  [[nodiscard]] Tensor first_features() const {
    core::RandomStream random(seed_, "pvlff_features");
    std::vector<float> values(static_cast<std::size_t>(surfels() * kInstanceSize));
    for (float& value : values) {
      value = static_cast<float>(config_.pvlff.feature_noise * random.normal());
    }
    std::vector<float> frequency, phase;
    for (std::int64_t i = 0; i < 3 * kInstanceSize; ++i) {
      frequency.push_back(
          static_cast<float>(2.0 * std::numbers::pi / kWaveLength_m * random.normal()));
    }
    for (std::int64_t i = 0; i < kInstanceSize; ++i) {
      phase.push_back(static_cast<float>(random.uniform(0.0, 2.0 * std::numbers::pi)));
    }
    const Tensor waves = torch::sin(
        positions_tensor(inputs_.position_m, device_)
            .matmul(
                device_tensor(frequency, torch::kFloat32, device_).view({3, kInstanceSize})) +
        device_tensor(phase, torch::kFloat32, device_));
    return kWaveHeight * waves +
           device_tensor(values, torch::kFloat32, device_).view({-1, kInstanceSize});
  }

  /// L1 distance to the class of the mask as a vector.
  void add_language_loss(LossSum& sum, const Tensor& rendered,
                         const BatchTargets& targets) const {
    const MaskTargets masks = mask_targets(targets, targets.labelled, device_);
    const Tensor label = device_tensor(targets.class_index, torch::kInt64, device_)
                             .index_select(0, masks.pixels);
    const Tensor feature = rendered.index_select(0, masks.pixels);
    const Tensor one_hot = torch::zeros_like(feature).scatter_(1, label.unsqueeze(1), 1.0);
    sum.add("language", config_.pvlff.language,
            ((feature - one_hot).abs().mean(1) * masks.weight).mean());
  }

  /// Anchors are drawn from regions by their size.
  [[nodiscard]] Groups draw_groups(const Regions& regions, std::int64_t iteration) const {
    core::RandomStream random(seed_, "pvlff_groups", static_cast<std::uint64_t>(iteration));
    std::vector<std::pair<std::size_t, std::int64_t>> all;  // Region, pixel.
    for (std::size_t r = 0; r < regions.pixels.size(); ++r) {
      for (const std::int64_t pixel : regions.pixels[r]) all.emplace_back(r, pixel);
    }
    const auto draw = [&] {
      return all[random.index(static_cast<std::uint32_t>(all.size()))];
    };
    std::vector<std::int64_t> anchor, positive, negative, region;
    for (int g = 0; g < config_.pvlff.groups; ++g) {
      const auto [r, pixel] = draw();
      const std::vector<std::int64_t>& own = regions.pixels[r];
      anchor.push_back(pixel);
      positive.push_back(own[random.index(static_cast<std::uint32_t>(own.size()))]);
      region.push_back(static_cast<std::int64_t>(r));
      for (int n = 0; n < config_.pvlff.negatives;) {
        const auto [other, at] = draw();
        if (other == r) continue;
        negative.push_back(at);
        ++n;
      }
    }
    return {device_tensor(anchor, torch::kInt64, device_),
            device_tensor(positive, torch::kInt64, device_),
            device_tensor(negative, torch::kInt64, device_),
            device_tensor(region, torch::kInt64, device_)};
  }

  /// @param feature  [pixels, 8], rendered, of unit length.
  void add_instance_losses(LossSum& sum, const Tensor& feature, const Regions& regions,
                           std::int64_t frame, std::int64_t iteration) {
    const PvlffConfig& pvlff = config_.pvlff;
    const Groups groups = draw_groups(regions, iteration);
    const Tensor anchor = feature.index_select(0, groups.anchor);
    const Tensor fixed = feature.detach();
    const Tensor positive = fixed.index_select(0, groups.positive);
    const Tensor negative =
        fixed.index_select(0, groups.negative).view({anchor.size(0), -1, kInstanceSize});
    const Tensor cosine =
        torch::cat({(anchor * positive).sum(1, true), (anchor.unsqueeze(1) * negative).sum(2)},
                   1) /
        pvlff.temperature;
    sum.add("contrast", pvlff.contrast, -torch::log_softmax(cosine, 1).select(1, 0).mean());

    const Tensor centre =
        follow_centres(regions.means(fixed.index_select(0, regions.pixel)), regions, frame)
            .index_select(0, groups.region);
    sum.add(
        "centre", pvlff.contrast * pvlff.centre,
        ((anchor - centre).abs().mean(1) + 1.0 - (anchor * normalised(centre)).sum(1)).mean());
  }

  /// The centres of a frame's regions, after they have followed their pixels' means.
  [[nodiscard]] Tensor follow_centres(const Tensor& means, const Regions& regions,
                                      std::int64_t frame) {
    std::vector<Tensor> centres;
    for (std::int64_t r = 0; r < regions.count(); ++r) {
      const MaskKey key{frame, regions.key[static_cast<std::size_t>(r)]};
      const auto [at, is_new] = centres_.try_emplace(key, means[r].clone());
      if (!is_new) at->second.lerp_(means[r], 1.0 - config_.pvlff.centre_momentum);
      centres.push_back(at->second);
    }
    return torch::stack(centres);
  }

  /// [clusters, 8], of unit length.
  [[nodiscard]] Tensor cluster_centres() const;

  PanopticHeadInputs inputs_;
  PanopticTrainingConfig config_;
  std::uint64_t seed_;
  at::Device device_;
  BlendMatrixMaker maker_;
  AdamTensor language_, instance_;  ///< [surfels, classes], [surfels, 8].
  PixelStore store_;
  std::map<MaskKey, Tensor> centres_;  ///< [8] of each mask of each frame seen so far.
};

Tensor PvlffHead::cluster_centres() const {
  const Tensor none = torch::zeros({0, kInstanceSize}, instance_.value().options());
  if (store_.size() < 2) return none;
  const Tensor feature = normalised(store_.blend(instance_.value())).cpu().contiguous();
  const auto points = static_cast<std::size_t>(feature.size(0));
  const std::span<const float> values{feature.data_ptr<float>(), points * kInstanceSize};
  const DensityClusters clusters = density_clusters(
      values, kInstanceSize, cluster_options(config_.pvlff.clustering, points, false));
  if (clusters.count == 0) return none;
  return normalised(
      device_tensor(cluster_means(values, kInstanceSize, clusters), torch::kFloat32, device_)
          .view({-1, kInstanceSize}));
}

/// The cluster of a pixel is the nearest in angle to its rendered feature: the largest blended
/// product, since the length of the feature is the same for all. Its class is the cluster's,
/// so classes and instances have the same scores.
PanopticResult PvlffHead::result() const {
  const at::NoGradGuard no_grad;
  PanopticResult result;
  renderer::PanopticField& field = result.field;
  const Tensor centres = cluster_centres();
  field.instances = scores_of_logits(instance_.value().matmul(centres.t()));
  field.classes = field.instances;
  if (centres.size(0) == 0) return result;
  const Tensor cluster = store_.blend(instance_.value()).matmul(centres.t()).argmax(1);
  const Tensor language = store_.blend(language_.value());
  const Tensor of_cluster =
      torch::zeros({centres.size(0), language.size(1)}, language.options())
          .index_add(0, cluster, language)
          .argmax(1)
          .cpu();
  for (std::int64_t j = 0; j < centres.size(0); ++j) {
    const core::SceneClass& c =
        inputs_.classes[static_cast<std::size_t>(of_cluster.data_ptr<std::int64_t>()[j])];
    field.class_id.push_back(c.id);
    field.class_is_thing.push_back(c.thing ? 1 : 0);
    field.instance_id.push_back(static_cast<std::uint16_t>(1 + j));
  }
  return result;
}

void PvlffHead::save(const std::filesystem::path& file) const {
  StateWriter out(kName);
  language_.save(out, "surfel.language");
  instance_.save(out, "surfel.instance");
  store_.save(out);
  std::vector<std::int64_t> keys;
  std::vector<Tensor> rows{torch::zeros({0, kInstanceSize}, instance_.value().options())};
  for (const auto& [key, centre] : centres_) {
    keys.insert(keys.end(), {key.first, key.second});
    rows.push_back(centre.unsqueeze(0));
  }
  out.put_integers("centre.key", keys);
  out.put("centre.value", torch::cat(rows));
  out.write(file);
}

void PvlffHead::load(const std::filesystem::path& file) {
  const StateReader in(file, kName);
  in.expect_rows("surfel.language", surfels());
  in.expect_rows("surfel.instance", surfels());
  language_.load(in, "surfel.language");
  instance_.load(in, "surfel.instance");
  store_.load(in);
  const std::vector<std::int64_t> keys = in.integers("centre.key");
  const Tensor values =
      in.take("centre.value", torch::zeros({0, kInstanceSize}, instance_.value().options()));
  in.expect_rows("centre.value", static_cast<std::int64_t>(keys.size() / 2));
  centres_.clear();
  for (std::size_t i = 0; i + 1 < keys.size(); i += 2) {
    centres_.emplace(MaskKey{keys[i], keys[i + 1]},
                     values[static_cast<std::int64_t>(i / 2)].clone());
  }
}

}  // namespace

constinit const HeadMaker kMakePvlff = make_head<PvlffHead>;

}  // namespace segsim::reconstruction::internal
