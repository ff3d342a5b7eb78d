#include "reconstruction/labels/panoptic_training.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

#include "core/check.h"
#include "core/error.h"
#include "core/random.h"
#include "reconstruction/labels/guidance_graph.h"
#include "reconstruction/labels/internal/head_support.h"
#include "reconstruction/labels/internal/visible_surfels.h"
#include "reconstruction/labels/mask_association.h"
#include "reconstruction/labels/pixel_sampling.h"
#include "reconstruction/labels/query_seeding.h"

namespace segsim::reconstruction {
namespace {

/// The views of an epoch, each once, in random order.
class ViewOrder {
 public:
  ViewOrder(std::int64_t views, std::uint64_t seed)
      : seed_(seed), order_(static_cast<std::size_t>(views)) {}

  [[nodiscard]] std::int64_t view_of(std::int64_t iteration) {
    const auto count = static_cast<std::int64_t>(order_.size());
    if (iteration / count != epoch_) shuffle(iteration / count);
    return order_[static_cast<std::size_t>(iteration % count)];
  }

 private:
  void shuffle(std::int64_t epoch) {
    epoch_ = epoch;
    std::iota(order_.begin(), order_.end(), std::int64_t{0});
    core::RandomStream random(seed_, "panoptic_order", static_cast<std::uint64_t>(epoch));
    for (std::size_t i = order_.size(); i > 1; --i) {
      std::swap(order_[i - 1], order_[random.index(static_cast<std::uint32_t>(i))]);
    }
  }

  std::uint64_t seed_;
  std::vector<std::int64_t> order_;
  std::int64_t epoch_ = -1;
};

/// Labels of the masks at the sampled pixels.
struct SampledLabels {
  SampledLabels(const core::FrameMasks& masks, std::span<const std::int32_t> pixels) {
    const bool scored = !masks.confidence.empty();
    for (const std::int32_t pixel : pixels) {
      semantic.push_back(masks.semantic.data()[pixel]);
      instance.push_back(masks.instance.data()[pixel]);
      confidence.push_back(scored ? static_cast<float>(masks.confidence.data()[pixel]) / 255.0F
                                  : 1.0F);
    }
  }
  std::vector<std::uint16_t> semantic, instance;
  std::vector<float> confidence;
};

/// The same surface points in the next view (the one before for the last view).
struct WarpedRows {
  PixelWeights weights;
  std::vector<std::int64_t> row;  ///< By sampled pixel, -1 = none.
};

WarpedRows warped_rows(PanopticViews& views, std::int64_t view,
                       std::span<const std::int32_t> pixels,
                       const PanopticTrainingConfig& config) {
  const std::int64_t other = view + 1 < views.count() ? view + 1 : view - 1;
  const core::Image<float> depth_m = views.depth_m(view);
  const std::vector<std::int32_t> at =
      warp_pixels(pixels, depth_m, views.intrinsics(view), views.T_world_camera(view),
                  views.depth_m(other), views.intrinsics(other), views.T_world_camera(other),
                  config.max_warp_depth_error_m);
  WarpedRows warped;
  std::vector<std::int32_t> hits;
  for (const std::int32_t pixel : at) {
    warped.row.push_back(pixel < 0 ? -1 : static_cast<std::int64_t>(hits.size()));
    if (pixel >= 0) hits.push_back(pixel);
  }
  warped.weights = views.weights(other, hits, config.sampling.max_surfels_per_pixel, 1);
  return warped;
}

std::vector<NamedLoss> train_once(PanopticViews& views, PanopticHead& head,
                                  const PanopticTrainingRun& run, std::int64_t view,
                                  std::int64_t iteration) {
  core::RandomStream random(run.seed, "panoptic_pixels",
                            static_cast<std::uint64_t>(iteration));
  const core::FrameMasks& masks = views.masks(view);
  const PixelSample sample =
      sample_pixels(masks, views.depth_m(view), run.classes, run.config.sampling, random);
  const std::vector<std::int32_t>& pixels = sample.pixels;
  if (pixels.empty()) return {{"total", 0.0}};
  const SampledLabels labels(masks, pixels);
  PanopticBatch batch;
  batch.frame = view;
  batch.weights = views.weights(view, pixels, run.config.sampling.max_surfels_per_pixel, 0);
  SEGSIM_CHECK(batch.weights.pixels == static_cast<std::int64_t>(pixels.size()), "weights");
  batch.semantic = labels.semantic.data();
  batch.instance = labels.instance.data();
  batch.confidence = labels.confidence.data();
  if (run.config.sampling.by_importance) batch.importance = sample.importance.data();
  WarpedRows warped;
  if (run.warp && views.count() > 1 && !views.depth_m(view).empty()) {
    warped = warped_rows(views, view, pixels, run.config);
    batch.warped = &warped.weights;
    batch.warped_row = warped.row.data();
  }
  if (run.moving == nullptr) return head.step(batch, iteration);
  GeometryGradient gradient;
  batch.gradient = &gradient;
  std::vector<NamedLoss> losses = head.step(batch, iteration);
  run.moving->move(pixels, batch.weights, gradient);
  head.move_surfels(run.moving->positions_m());
  return losses;
}

}  // namespace

namespace {

/// A short sequence has too few views for the rule of min_views.
AssociationConfig association_config(const PanopticViews& views,
                                     const PanopticTrainingConfig& config) {
  AssociationConfig association = config.association;
  association.min_views =
      static_cast<int>(std::min<std::int64_t>(association.min_views, views.count()));
  return association;
}

/// @return  PanopticHeadInputs::object_of_mask.
std::vector<std::map<std::uint16_t, std::uint16_t>> associate_masks(
    PanopticViews& views, const PanopticTrainingConfig& config) {
  MaskAssociation association(association_config(views, config));
  std::vector<std::size_t> added;  // Views with depth.
  for (std::int64_t view = 0; view < views.count(); ++view) {
    const core::Image<float>& depth_m = views.depth_m(view);
    if (depth_m.empty()) continue;
    association.add_view(views.masks(view), depth_m, views.intrinsics(view),
                         views.T_world_camera(view));
    added.push_back(static_cast<std::size_t>(view));
  }
  std::vector<std::map<std::uint16_t, std::uint16_t>> object_of_mask(
      static_cast<std::size_t>(views.count()));
  std::uint16_t object_id = 0;
  for (const AssociatedObject& object : association.objects()) {  // Largest first.
    if (object_id == std::numeric_limits<std::uint16_t>::max()) break;
    ++object_id;
    for (const MaskOfView& mask : object.masks) {
      object_of_mask[added[static_cast<std::size_t>(mask.view)]][mask.id] = object_id;
    }
  }
  return object_of_mask;
}

/// Pixels y * width + x on a grid, about `count` of them.
std::vector<std::int32_t> grid_pixels(const core::FrameMasks& masks, int count) {
  const int width = masks.semantic.width_px(), height = masks.semantic.height_px();
  const int step = std::max(
      1, static_cast<int>(std::lround(
             std::sqrt(static_cast<double>(width) * static_cast<double>(height) / count))));
  std::vector<std::int32_t> pixels;
  for (int y = step / 2; y < height; y += step) {
    for (int x = step / 2; x < width; x += step) pixels.push_back(y * width + x);
  }
  return pixels;
}

GuidedObjects guide_masks(PanopticViews& views, const PanopticTrainingConfig& config,
                          const PanopticHeadInputs& inputs) {
  PanopticReconConfig recon = config.panoptic_recon;
  recon.min_views = static_cast<int>(std::min<std::int64_t>(recon.min_views, views.count()));
  std::vector<glm::vec3> normal;
  for (const glm::quat& R : inputs.R_world_surfel) normal.push_back(R * glm::vec3(0, 0, 1));
  GuidanceGraph graph(inputs.position_m, normal, recon);
  const at::Device device = internal::device_of(inputs.cuda_device);
  for (std::int64_t view = 0; view < views.count(); ++view) {
    const core::FrameMasks& masks = views.masks(view);
    const std::vector<std::int32_t> pixels = grid_pixels(masks, recon.pixels);
    graph.add_view(masks, pixels,
                   internal::first_surfels(views.weights(view, pixels, 1, 0), device));
  }
  return graph.objects();
}

}  // namespace

void prepare_head_inputs(const std::string& head, PanopticViews& views,
                         const PanopticTrainingConfig& config, std::uint64_t seed,
                         PanopticHeadInputs& inputs) {
  if (head == "query" || head == "panoptic-splatting") {
    inputs.query_seeds = seed_queries(views, config, seed);
  }
  if (head == "panoptic-recon++") {
    inputs.query_seeds = seed_queries(views, recon_plus_config(config), seed);
  }
  if (head == "gaussian-grouping" &&
      config.gaussian_grouping.identities == IdentitySource::kAssociated) {
    inputs.object_of_mask = associate_masks(views, config);
  }
  if (head == "panoptic-recon") {
    GuidedObjects objects = guide_masks(views, config, inputs);
    inputs.object_of_mask = std::move(objects.object_of_mask);
    inputs.object_class = std::move(objects.class_id);
  }
}

std::vector<QuerySeed> seed_queries(PanopticViews& views, const PanopticTrainingConfig& config,
                                    std::uint64_t seed) {
  const bool from_objects = config.query.seeding == QuerySeeding::kObjects;
  QuerySeeder points(config, seed);
  MaskAssociation masks(association_config(views, config));
  for (std::int64_t view = 0; view < views.count(); ++view) {
    const core::Image<float>& depth_m = views.depth_m(view);
    if (depth_m.empty()) continue;
    points.add_frame(view, views.masks(view), depth_m, views.intrinsics(view),
                     views.T_world_camera(view));
    if (from_objects) {
      masks.add_view(views.masks(view), depth_m, views.intrinsics(view),
                     views.T_world_camera(view));
    }
  }
  std::vector<QuerySeed> seeds;
  const auto factor = static_cast<float>(config.query.object_sigma);
  const auto most = static_cast<std::size_t>(config.query.max_queries);
  for (const AssociatedObject& object : masks.objects()) {  // Largest first.
    if (seeds.size() == most) break;
    seeds.push_back({object.mean_m, factor * object.sigma_m});
  }
  if (!seeds.empty()) return seeds;
  // A grid was asked for, or no two views agree on anything.
  const glm::vec3 sigma_m(static_cast<float>(config.query.initial_sigma_m));
  for (const glm::vec3& point_m : points.seeds_m()) seeds.push_back({point_m, sigma_m});
  return seeds;
}

std::int64_t train_panoptic(PanopticViews& views, PanopticHead& head,
                            const PanopticTrainingRun& run) {
  check_panoptic_config(run.config);
  SEGSIM_CHECK(run.first_iteration >= 0 && run.checkpoint_every > 0, "iterations");
  SEGSIM_CHECK(run.moving == nullptr || run.config.sampling.max_surfels_per_pixel == 0,
               "joint training needs all weights of a pixel");
  if (views.count() == 0) {
    throw core::InputError::expected("label training", "at least one view with masks", "none");
  }
  ViewOrder order(views.count(), run.seed);
  const std::int64_t last = run.config.iterations;
  std::int64_t done = std::min(run.first_iteration, last);
  while (done < last) {
    const std::vector<NamedLoss> losses =
        train_once(views, head, run, order.view_of(done), done);
    ++done;
    const bool go_on = !run.on_progress || run.on_progress({done, last, losses});
    const bool due = done % run.checkpoint_every == 0 || done == last || !go_on;
    if (due && run.on_checkpoint) run.on_checkpoint(done);
    if (!go_on) break;
  }
  return done;
}

std::vector<std::int32_t> warp_pixels(
    std::span<const std::int32_t> pixels, const core::Image<float>& depth_m,
    const core::CameraIntrinsics& camera, const core::CameraPose& T_world_camera,
    const core::Image<float>& other_depth_m, const core::CameraIntrinsics& other_camera,
    const core::CameraPose& T_world_other, double max_error_m) {
  std::vector<std::int32_t> result(pixels.size(), -1);
  const auto T_other_camera = T_world_other.inverse() * T_world_camera;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const int x = pixels[i] % depth_m.width_px(), y = pixels[i] / depth_m.width_px();
    const auto depth = static_cast<double>(depth_m(x, y));
    if (!(depth > 0.0)) continue;
    const glm::dvec3 p_m =
        T_other_camera.rotation() * camera.back_project({x + 0.5, y + 0.5}, depth) +
        T_other_camera.translation_m();
    if (p_m.z <= 0.0) continue;
    const glm::dvec2 px = glm::floor(other_camera.project(p_m));
    if (!(px.x >= 0.0 && px.y >= 0.0 && px.x < other_depth_m.width_px() &&
          px.y < other_depth_m.height_px())) {
      continue;
    }
    const int u = static_cast<int>(px.x), v = static_cast<int>(px.y);
    if (!(std::abs(static_cast<double>(other_depth_m(u, v)) - p_m.z) <= max_error_m)) continue;
    result[i] = v * other_depth_m.width_px() + u;
  }
  return result;
}

}  // namespace segsim::reconstruction
