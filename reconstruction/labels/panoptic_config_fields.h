#pragma once

/// @file
/// The keys of label training's configuration, once: reading, writing and checking walk this
/// list.

#include <cstdint>

#include "reconstruction/labels/panoptic_config.h"

namespace segsim::reconstruction::internal {

inline constexpr double kNoLimit = 1e18;

/// A field is visited as number(key, value, lowest, highest), integer(...), flag(key, value)
/// or choice(key, value, words); sections as enter(key) ... leave().
template <class Visitor>
void visit_query(QueryConfig& q, Visitor& v) {
  v.enter("query");
  v.choice("variant", q.variant,
           {"temperature", "normalised", "log-softmax", "raw", "literal"});
  v.number("none_score", q.none_score, 1e-9, 1.0);
  v.number("raw_none_score", q.raw_none_score, 0.0, 1.0);
  v.number("temperature", q.temperature, 1e-6, kNoLimit);
  v.number("initial_sigma_m", q.initial_sigma_m, 1e-6, kNoLimit);
  v.number("min_sigma_m", q.min_sigma_m, 1e-6, kNoLimit);
  v.number("max_sigma_m", q.max_sigma_m, 1e-6, kNoLimit);
  v.number("feature_noise", q.feature_noise, 0.0, kNoLimit);
  v.choice("seeding", q.seeding, {"objects", "grid"});
  v.number("object_sigma", q.object_sigma, 1e-6, kNoLimit);
  v.integer("seeds_per_mask", q.seeds_per_mask, 1, 1'000'000);
  v.number("seed_voxel_m", q.seed_voxel_m, 1e-6, kNoLimit);
  v.integer("max_queries", q.max_queries, 1, 65534);
  v.number("min_queries_per_mask", q.min_queries_per_mask, 0.0, kNoLimit);
  v.number("class_cost", q.class_cost, 0.0, kNoLimit);
  v.number("max_dice", q.max_dice, 0.0, 1.0);
  v.number("gate_from", q.gate_from, 0.0, 1.0);
  v.integer("min_mask_pixels", q.min_mask_pixels, 0, 1'000'000);
  v.flag("ignore_unmatched", q.ignore_unmatched);
  v.number("visible_share", q.visible_share, 0.0, 1.0);
  v.number("prune_from", q.prune_from, 0.0, 1.0);
  v.number("prune_every", q.prune_every, 1e-6, 1.0);
  v.integer("min_frames", q.min_frames, 1, 64);
  v.number("overlap_score", q.overlap_score, 0.0, 1.0);
  v.number("max_overlap", q.max_overlap, 0.0, 1.0);
  v.leave();
}

template <class Visitor>
void visit_association(AssociationConfig& a, Visitor& v) {
  v.enter("association");
  v.number("voxel_m", a.voxel_m, 1e-6, kNoLimit);
  v.integer("pixels", a.pixels, 1, 100'000'000);
  v.number("min_depth_m", a.min_depth_m, 0.0, kNoLimit);
  v.number("min_visible", a.min_visible, 0.0, 1.0);
  v.number("min_inside", a.min_inside, 0.0, 1.0);
  v.number("min_consensus", a.min_consensus, 1e-9, 1.0);
  v.integer("min_views", a.min_views, 1, 1'000'000);
  v.integer("min_voxels", a.min_voxels, 1, 1'000'000);
  v.number("min_won", a.min_won, 0.0, 1.0);
  v.leave();
}

template <class Visitor>
void visit_clustering(DensityClusteringConfig& c, Visitor& v) {
  v.enter("clustering");
  v.integer("points", c.points, 1, 100'000);
  v.number("min_share", c.min_share, 0.0, 1.0);
  v.integer("min_samples", c.min_samples, 1, 10'000);
  v.leave();
}

/// Heads of other papers.
template <class Visitor>
void visit_baselines(PanopticTrainingConfig& p, Visitor& v) {
  v.enter("panoptic_lifting");
  v.integer("slots", p.panoptic_lifting.slots, 1, 65534);
  v.number("semantic", p.panoptic_lifting.semantic, 0.0, kNoLimit);
  v.number("segment", p.panoptic_lifting.segment, 0.0, kNoLimit);
  v.number("instance", p.panoptic_lifting.instance, 0.0, kNoLimit);
  v.number("instance_from", p.panoptic_lifting.instance_from, 0.0, 1.0);
  v.number("segment_from", p.panoptic_lifting.segment_from, 0.0, 1.0);
  v.number("rate", p.panoptic_lifting.rate, 0.0, 1.0);
  v.leave();
  ContrastiveLiftConfig& lift = p.contrastive_lift;
  v.enter("contrastive_lift");
  v.number("instance", lift.instance, 0.0, kNoLimit);
  v.number("semantic_from", lift.semantic_from, 0.0, 1.0);
  v.number("instance_from", lift.instance_from, 0.0, 1.0);
  v.number("segment_from", lift.segment_from, 0.0, 1.0);
  v.integer("pixels", lift.pixels, 2, 1'000'000);
  v.number("slow_momentum", lift.slow_momentum, 0.0, 1.0);
  v.number("feature_noise", lift.feature_noise, 1e-9, kNoLimit);
  v.number("rate", lift.rate, 0.0, 1.0);
  visit_clustering(lift.clustering, v);
  v.leave();
  GaussianGroupingConfig& grouping = p.gaussian_grouping;
  v.enter("gaussian_grouping");
  v.choice("identities", grouping.identities, {"associated", "assigned"});
  v.integer("ids", grouping.ids, 2, 65534);
  v.number("identity", grouping.identity, 0.0, kNoLimit);
  v.number("smoothness", grouping.smoothness, 0.0, kNoLimit);
  v.integer("smoothness_every", grouping.smoothness_every, 1, 10'000'000);
  v.integer("smoothness_surfels", grouping.smoothness_surfels, 1, 1'000'000);
  v.integer("neighbours", grouping.neighbours, 1, 1000);
  v.number("rate", grouping.rate, 0.0, 1.0);
  v.number("classifier_rate", grouping.classifier_rate, 0.0, 1.0);
  v.leave();
  OpenGaussianConfig& open = p.open_gaussian;
  v.enter("open_gaussian");
  v.number("coarse_from", open.coarse_from, 0.0, 1.0);
  v.number("fine_from", open.fine_from, 0.0, 1.0);
  v.number("separation", open.separation, 0.0, kNoLimit);
  v.number("cohesion", open.cohesion, 0.0, kNoLimit);
  v.number("sharpen_from", open.sharpen_from, 0.0, 1.0);
  v.integer("coarse", open.coarse, 1, 4096);
  v.integer("fine", open.fine, 1, 64);
  v.number("position_weight", open.position_weight, 0.0, kNoLimit);
  v.integer("rounds", open.rounds, 1, 1000);
  v.number("coarse_every", open.coarse_every, 1e-9, 1.0);
  v.number("fine_every", open.fine_every, 1e-9, 1.0);
  v.number("max_variance", open.max_variance, 0.0, kNoLimit);
  v.number("large_mask", open.large_mask, 0.0, kNoLimit);
  v.number("rate", open.rate, 0.0, 1.0);
  v.integer("points", open.points, 1, 10'000'000);
  v.number("min_score", open.min_score, 0.0, 1.0);
  v.number("min_together", open.min_together, 1e-9, 1.0);
  v.leave();
  PanopticReconConfig& recon = p.panoptic_recon;
  v.enter("panoptic_recon");
  v.integer("neighbours", recon.neighbours, 1, 1000);
  v.number("max_gap_m", recon.max_gap_m, 1e-9, kNoLimit);
  v.number("max_angle_deg", recon.max_angle_deg, 0.0, 90.0);
  v.number("max_radius_m", recon.max_radius_m, 1e-9, kNoLimit);
  v.integer("min_surfels", recon.min_surfels, 1, 1'000'000);
  v.integer("pixels", recon.pixels, 1, 100'000'000);
  v.number("min_inside", recon.min_inside, 0.0, 1.0);
  v.integer("min_views", recon.min_views, 1, 1'000'000);
  v.number("semantic", recon.semantic, 0.0, kNoLimit);
  v.number("instance", recon.instance, 0.0, kNoLimit);
  v.number("rate", recon.rate, 0.0, 1.0);
  v.leave();
  PanopticReconPlusConfig& plus = p.panoptic_recon_plus;
  v.enter("panoptic_recon_plus");
  v.number("semantic", plus.semantic, 0.0, kNoLimit);
  v.number("instance", plus.instance, 0.0, kNoLimit);
  v.number("panoptic", plus.panoptic, 0.0, kNoLimit);
  v.number("repulsion", plus.repulsion, 0.0, kNoLimit);
  v.number("panoptic_from", plus.panoptic_from, 0.0, 1.0);
  v.flag("unlabelled_negative", plus.unlabelled_negative);
  v.number("feature_rate", plus.feature_rate, 0.0, 1.0);
  v.number("decoder_rate", plus.decoder_rate, 0.0, 1.0);
  v.number("query_position_m", plus.query_position_m, 0.0, 1.0);
  v.number("query_log_sigma", plus.query_log_sigma, 0.0, 1.0);
  v.number("final_factor", plus.final_factor, 1e-9, kNoLimit);
  v.number("initial_sigma_m", plus.initial_sigma_m, 1e-6, kNoLimit);
  v.number("max_dice", plus.max_dice, 0.0, 1.0);
  v.number("prune_from", plus.prune_from, 0.0, 1.0);
  v.number("prune_every", plus.prune_every, 1e-6, 1.0);
  v.number("overlap_score", plus.overlap_score, 0.0, 1.0);
  v.leave();
  PvlffConfig& pvlff = p.pvlff;
  v.enter("pvlff");
  v.number("language", pvlff.language, 0.0, kNoLimit);
  v.number("contrast", pvlff.contrast, 0.0, kNoLimit);
  v.number("centre", pvlff.centre, 0.0, kNoLimit);
  v.integer("groups", pvlff.groups, 1, 1'000'000);
  v.integer("negatives", pvlff.negatives, 1, 1000);
  v.number("temperature", pvlff.temperature, 1e-6, kNoLimit);
  v.number("centre_momentum", pvlff.centre_momentum, 0.0, 1.0);
  v.number("feature_noise", pvlff.feature_noise, 1e-9, kNoLimit);
  v.number("rate", pvlff.rate, 0.0, 1.0);
  visit_clustering(pvlff.clustering, v);
  v.leave();
}

template <class Visitor>
void visit_panoptic(PanopticTrainingConfig& p, Visitor& v) {
  v.enter("panoptic");
  v.integer("iterations", p.iterations, 1, 10'000'000);
  v.choice("void_policy", p.void_policy, {"ignored", "negative"});
  v.flag("use_confidence", p.use_confidence);
  v.number("max_warp_depth_error_m", p.max_warp_depth_error_m, 0.0, kNoLimit);
  v.enter("sampling");
  v.integer("pixels", p.sampling.pixels, 1, 100'000'000);
  v.number("stuff_share", p.sampling.stuff_share, 0.0, 1.0);
  v.number("instance_share", p.sampling.instance_share, 0.0, 1.0);
  v.number("even_share", p.sampling.even_share, 0.0, 1.0);
  v.flag("by_importance", p.sampling.by_importance);
  v.integer("max_surfels_per_pixel", p.sampling.max_surfels_per_pixel, 0, 100'000);
  v.number("min_depth_m", p.sampling.min_depth_m, 0.0, kNoLimit);
  v.number("min_alpha", p.sampling.min_alpha, 0.0, 1.0);
  v.leave();
  v.enter("loss");
  v.number("semantic", p.loss.semantic, 0.0, kNoLimit);
  v.number("dice", p.loss.dice, 0.0, kNoLimit);
  v.number("bce", p.loss.bce, 0.0, kNoLimit);
  v.number("query_class", p.loss.query_class, 0.0, kNoLimit);
  v.number("no_object", p.loss.no_object, 0.0, kNoLimit);
  v.number("panoptic", p.loss.panoptic, 0.0, kNoLimit);
  v.number("repulsion", p.loss.repulsion, 0.0, kNoLimit);
  v.number("repulsion_margin", p.loss.repulsion_margin, 0.0, kNoLimit);
  v.number("warp", p.loss.warp, 0.0, kNoLimit);
  v.number("warp_of_ps", p.loss.warp_of_ps, 0.0, kNoLimit);
  v.number("panoptic_from", p.loss.panoptic_from, 0.0, 1.0);
  v.leave();
  v.enter("rate");
  v.number("semantic_feature", p.rate.semantic_feature, 0.0, 1.0);
  v.number("instance_feature", p.rate.instance_feature, 0.0, 1.0);
  v.number("decoder", p.rate.decoder, 0.0, 1.0);
  v.number("class_head", p.rate.class_head, 0.0, 1.0);
  v.number("query_feature", p.rate.query_feature, 0.0, 1.0);
  v.number("query_class_feature", p.rate.query_class_feature, 0.0, 1.0);
  v.number("query_position_m", p.rate.query_position_m, 0.0, 1.0);
  v.number("query_log_sigma", p.rate.query_log_sigma, 0.0, 1.0);
  v.number("query_rotation", p.rate.query_rotation, 0.0, 1.0);
  v.number("final_factor", p.rate.final_factor, 1e-9, kNoLimit);
  v.number("decay_from", p.rate.decay_from, 0.0, 1.0);
  v.number("scale", p.rate.scale, 1e-9, kNoLimit);
  v.leave();
  visit_query(p.query, v);
  visit_association(p.association, v);
  visit_baselines(p, v);
  v.leave();
}

}  // namespace segsim::reconstruction::internal
