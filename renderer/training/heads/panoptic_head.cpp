#include "renderer/training/heads/panoptic_head.h"

#include <cmath>
#include <set>

#include "core/check.h"
#include "core/error.h"
#include "renderer/training/heads/internal/head_list.h"

namespace segsim::renderer {
namespace {

void check_share(double value, const std::string& name) {
  SEGSIM_CHECK(value >= 0.0 && value <= 1.0, name + " = " + std::to_string(value));
}
void check_factor(double value, const std::string& name) {
  SEGSIM_CHECK(value >= 0.0 && std::isfinite(value), name + " = " + std::to_string(value));
}
void check_positive(double value, const std::string& name) {
  SEGSIM_CHECK(value > 0.0 && std::isfinite(value), name + " = " + std::to_string(value));
}

void check_sampling(const PixelSamplingConfig& s) {
  SEGSIM_CHECK(s.pixels > 0, "pixels");
  SEGSIM_CHECK(s.max_surfels_per_pixel >= 0, "max_surfels_per_pixel");
  check_share(s.stuff_share, "stuff_share");
  check_share(s.instance_share, "instance_share");
  check_share(s.stuff_share + s.instance_share, "stuff_share + instance_share");
  check_factor(s.min_depth_m, "min_depth_m");
  check_share(s.min_alpha, "min_alpha");
}

void check_losses(const HeadLossConfig& loss) {
  check_factor(loss.semantic, "semantic");
  check_factor(loss.dice, "dice");
  check_factor(loss.bce, "bce");
  check_factor(loss.query_class, "query_class");
  check_factor(loss.no_object, "no_object");
  check_factor(loss.panoptic, "panoptic");
  check_factor(loss.repulsion, "repulsion");
  check_factor(loss.repulsion_margin, "repulsion_margin");
  check_factor(loss.warp, "warp");
  check_factor(loss.warp_of_ps, "warp_of_ps");
  check_share(loss.panoptic_from, "panoptic_from");
}

void check_rates(const HeadRateConfig& rate) {
  check_factor(rate.semantic_feature, "semantic_feature");
  check_factor(rate.instance_feature, "instance_feature");
  check_factor(rate.decoder, "decoder");
  check_factor(rate.class_head, "class_head");
  check_factor(rate.query_feature, "query_feature");
  check_factor(rate.query_class_feature, "query_class_feature");
  check_factor(rate.query_position_m, "query_position_m");
  check_factor(rate.query_log_sigma, "query_log_sigma");
  check_factor(rate.query_rotation, "query_rotation");
  check_positive(rate.final_factor, "final_factor");
  check_share(rate.decay_from, "decay_from");
  check_positive(rate.scale, "scale");
}

void check_queries(const QueryConfig& query) {
  check_positive(query.temperature, "temperature");
  check_factor(query.none_score, "none_score");
  check_factor(query.raw_none_score, "raw_none_score");
  check_positive(query.min_sigma_m, "min_sigma_m");
  SEGSIM_CHECK(
      query.min_sigma_m <= query.initial_sigma_m && query.initial_sigma_m <= query.max_sigma_m,
      "initial_sigma_m = " + std::to_string(query.initial_sigma_m));
  check_factor(query.feature_noise, "feature_noise");
  SEGSIM_CHECK(query.seeds_per_mask > 0, "seeds_per_mask");
  check_positive(query.seed_voxel_m, "seed_voxel_m");
  SEGSIM_CHECK(query.max_queries > 0 && query.max_queries < 65535, "max_queries");
  check_factor(query.min_queries_per_mask, "min_queries_per_mask");
  check_factor(query.class_cost, "class_cost");
  check_share(query.max_dice, "max_dice");
  check_share(query.gate_from, "gate_from");
  check_share(query.visible_share, "visible_share");
  check_share(query.prune_from, "prune_from");
  check_positive(query.prune_every, "prune_every");
  SEGSIM_CHECK(query.min_frames >= 1 && query.min_frames <= 64, "min_frames");
  check_share(query.overlap_score, "overlap_score");
  check_share(query.max_overlap, "max_overlap");
}

}  // namespace

void check_panoptic_config(const PanopticTrainingConfig& config) {
  SEGSIM_CHECK(config.iterations > 0, "iterations");
  check_factor(config.max_warp_depth_error_m, "max_warp_depth_error_m");
  check_sampling(config.sampling);
  check_losses(config.loss);
  check_rates(config.rate);
  check_queries(config.query);
  SEGSIM_CHECK(config.panoptic_lifting.slots >= 1 && config.panoptic_lifting.slots < 65535,
               "slots");
  check_factor(config.panoptic_lifting.rate, "panoptic_lifting rate");
}

std::vector<std::string> panoptic_head_names() {
  return {"query", "panoptic-splatting", "panoptic-lifting"};
}

std::unique_ptr<PanopticHead> make_panoptic_head(const std::string& name,
                                                 PanopticHeadInputs inputs,
                                                 const PanopticTrainingConfig& config,
                                                 std::uint64_t seed) {
  check_panoptic_config(config);
  SEGSIM_CHECK(!inputs.classes.empty(), "no classes");
  std::set<std::uint16_t> ids;
  for (const core::SceneClass& c : inputs.classes) {
    SEGSIM_CHECK(c.id != 0 && ids.insert(c.id).second, "class " + std::to_string(c.id));
  }
  if (name == "query") {
    return internal::make_query_head(name, std::move(inputs), config, seed, config.loss.warp);
  }
  if (name == "panoptic-splatting") {
    return internal::make_panoptic_splatting_head(std::move(inputs), config, seed);
  }
  if (name == "panoptic-lifting") {
    return internal::make_panoptic_lifting_head(std::move(inputs), config, seed);
  }
  std::string names;
  for (const std::string& known : panoptic_head_names()) {
    names += (names.empty() ? "" : ", ") + known;
  }
  throw core::InputError::expected("head", names, "\"" + name + "\"");
}

}  // namespace segsim::renderer
