#pragma once

/// @file
/// Every weight and rate of panoptic training. Sources: "paper" = Fast-SegSim; PR++ =
/// PanopticRecon++ (the paper's direct ancestor, as released); GG = Gaussian Grouping; PL =
/// Panoptic Lifting; PS = PanopticSplatting; ours = a choice of this project, measured or
/// argued in docs/training.md. Shares are of the iterations of the whole head training, so
/// that a short run keeps the order of events.

#include <cstdint>

#include <glm/vec3.hpp>

#include "reconstruction/labels/heads/baseline_config.h"
#include "renderer/scene/panoptic_field.h"

namespace segsim::reconstruction {

/// What pixels without a label say about instances.
enum class VoidPolicy : std::uint8_t {
  kIgnored,   ///< Nothing (ours): 27 % of the true segments have no mask in a view.
  kNegative,  ///< "No instance here" (PR++).
};

/// Which pixels of an image are trained on. The rest of the samples is uniform.
struct PixelSamplingConfig {
  int pixels = 16384;           ///< Of one image an iteration (ours; PR++: 10 x 1000).
  double stuff_share = 0.5;     ///< Drawn from pixels of stuff classes (PR++).
  double instance_share = 0.2;  ///< Drawn from pixels with an instance (PR++).
  double even_share = 0.5;      ///< Of these: as many pixels of each mask (ours).
  /// Pixels weigh in losses as if they had been drawn evenly over the image (ours).
  bool by_importance = true;
  int max_surfels_per_pixel = 0;  ///< The heaviest; 0 = all.
  double min_depth_m = 0.3;       ///< Nearer pixels are not used (PR++).
  double min_alpha = 0.5;         ///< Pixels that the surfels cover less are not used (ours).
};

/// Factors of the losses.
struct HeadLossConfig {
  double semantic = 1.0;     ///< NLL of the blended class (ours; PR++ 80 beside rgb 30).
  double dice = 1.0;         ///< Paper, "Instance Loss": a plain sum.
  double bce = 1.0;          ///< The same.
  double query_class = 0.5;  ///< Class of queries (ours; PR++ uses the same factor in costs).
  double no_object = 0.1;    ///< Of unmatched queries in that loss (as in DETR).
  double panoptic = 1.0;     ///< NLL of the panoptic label (ours; PR++ 10).
  double repulsion = 0.01;   ///< Of similar queries (ours; PR++ 100 in its scale).
  double repulsion_margin = 10.0;  ///< PR++.
  double warp = 0.0;           ///< Agreement with a neighbouring frame; PS head: warp_of_ps.
  double warp_of_ps = 0.1;     ///< PS (the idea; the factor is ours).
  double panoptic_from = 0.6;  ///< Share of training before L_pan (ours; PR++ epoch 3 of 20).
};

/// Learning rates (Adam, betas 0.9 and 0.999).
struct HeadRateConfig {
  double semantic_feature = 0.02;     ///< Ours (GG, identity encoding: 0.0025).
  double instance_feature = 6e-3;     ///< Ours (GG: 0.0025).
  double decoder = 4e-3;              ///< Ours (GG, classifier: 5e-4).
  double class_head = 1e-3;           ///< PR++, instance head; also the query embedding.
  double query_feature = 5e-3;        ///< PR++.
  double query_class_feature = 1e-2;  ///< PR++.
  /// Ours (PR++: 0.02 m, which is 5e-3 in a scene of 4 m scaled to 1, and 0.01): Adam moves
  /// queries that nothing pulls at full speed, and objects are a good start.
  double query_position_m = 5e-4, query_log_sigma = 1e-3;
  double query_rotation = 2e-3;  ///< PR++.
  double final_factor = 0.1;     ///< Exponential decay to this factor (ours) ...
  double decay_from = 0.33;      ///< ... from this share of training on.
  double scale = 1.0;            ///< Of all rates: > 1 for runs shorter than 3000 (ours).
};

/// Which masks of different views show one object (mask_association.h). All ours.
struct AssociationConfig {
  double voxel_m = 0.05;       ///< Surfaces are compared in voxels of this size.
  int pixels = 20000;          ///< Of a view, on a grid.
  double min_depth_m = 0.3;    ///< Nearer pixels are not used.
  double min_visible = 0.3;    ///< Of a mask's voxels, in a view that has a say.
  double min_inside = 0.5;     ///< Of those: then the mask lies in one of the view's.
  double min_consensus = 0.4;  ///< Of the views that see two masks, to join them.
  int min_views = 3;           ///< An object has masks in so many views, ...
  int min_voxels = 5;          ///< ... wins so many voxels, ...
  double min_won = 0.2;        ///< ... and this share of those that its masks cover.
};

/// Where queries begin.
enum class QuerySeeding : std::uint8_t {
  kObjects,  ///< At the objects that masks of several views agree on (mask_association.h).
  kGrid,     ///< At points of the masks, thinned by a grid (PR++, query_seeding.h).
};

/// Position and standard deviation along the axes of the world that a query begins with.
struct QuerySeed {
  glm::vec3 position_m{0.0F}, sigma_m{0.5F};
  bool operator==(const QuerySeed&) const = default;
};

struct QueryConfig {
  renderer::LabelVariant variant = renderer::LabelVariant::kNormalised;
  double none_score = 0.05;      ///< Of kNormalised and kLogSoftmax (ours).
  double raw_none_score = 0.3;   ///< Of kRaw, only where labels are read off (ours).
  double temperature = 0.1;      ///< Of kTemperature (ours).
  double initial_sigma_m = 0.5;  ///< Ours; PR++ 1 m, most of a small room.
  double min_sigma_m = 0.05, max_sigma_m = 2.0;  ///< Ours.
  double feature_noise = 0.01;  ///< Initial features N(0, this): repulsion needs it (ours).

  QuerySeeding seeding = QuerySeeding::kObjects;
  double object_sigma = 2.0;  ///< kObjects: standard deviations of the object (ours).
  // kGrid (PR++).
  int seeds_per_mask = 3;     ///< Pixels of every mask of every frame.
  double seed_voxel_m = 0.8;  ///< Grid in which seeds are thinned, one for every class.
  int max_queries = 150;
  double min_queries_per_mask = 2.0;  ///< At least this times the masks of the fullest frame.

  // Matching (PR++).
  double class_cost = 0.5;  ///< Beside dice + bce.
  double max_dice = 0.7;    ///< A match with a larger dice loss is none (PR++ 0.9) ...
  double gate_from = 0.2;   ///< ... from this share of training on (ours).
  int min_mask_pixels = 5;  ///< Samples of a mask that takes part (ours).
  /// Pixels of a mask that got no query say nothing to the queries of others (ours; PR++:
  /// they are not theirs).
  bool ignore_unmatched = true;
  double visible_share =
      0.002;  ///< Of the samples: a query that wins less is not seen (ours).

  // Pruning (PR++: every 300 of 6000 from epoch 2; shares are ours).
  double prune_from = 0.2, prune_every = 0.067;
  int min_frames = 3;          ///< Distinct frames in which a query was matched (ours).
  double overlap_score = 0.5;  ///< Surfels of a query for the overlap: A > this (PR++ 0.8).
  double max_overlap = 0.7;    ///< Of the smaller set; the less matched query goes (PR++).
};

struct PanopticTrainingConfig {
  std::int64_t iterations = 3000;  ///< Head iterations, one image each (ours).
  VoidPolicy void_policy = VoidPolicy::kIgnored;
  bool use_confidence = true;            ///< Scores of masks multiply pixel losses (PL).
  double max_warp_depth_error_m = 0.05;  ///< Depths agree for warping (ours, after PS).
  PixelSamplingConfig sampling;
  HeadLossConfig loss;
  HeadRateConfig rate;
  QueryConfig query;
  AssociationConfig association;
  // Of the heads of that name.
  PanopticLiftingConfig panoptic_lifting;
  ContrastiveLiftConfig contrastive_lift;
  GaussianGroupingConfig gaussian_grouping;
  OpenGaussianConfig open_gaussian;
  PanopticReconConfig panoptic_recon;
  PanopticReconPlusConfig panoptic_recon_plus;
  PvlffConfig pvlff;
};

/// The same with what PanopticRecon++ does otherwise than the paper's head.
[[nodiscard]] PanopticTrainingConfig recon_plus_config(PanopticTrainingConfig config);

/// @throws core::ContractViolation naming the field that is out of range.
void check_panoptic_config(const PanopticTrainingConfig& config);

}  // namespace segsim::reconstruction
