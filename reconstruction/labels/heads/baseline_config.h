#pragma once

/// @file
/// Weights and rates of the heads that other papers published. Sources: PL = Panoptic Lifting,
/// CL = Contrastive Lift, GG = Gaussian Grouping, OG = OpenGaussian, PVLFF, PR++ =
/// PanopticRecon++, as their programs have them; ours = a choice of this project. Shares are
/// of the iterations of the whole head training. Rates are those of a run of 3000 iterations
/// and follow rate.scale and its decay: a surfel is seen a few dozen times in one, and shares
/// nothing with its neighbours, where the original trained a network, or ten times as long.

#include <cstdint>

namespace segsim::reconstruction {

/// Panoptic Lifting on surfels. Heads that learn classes apart from instances, without
/// queries, take their class loss, segment loss and rate of logits from here.
struct PanopticLiftingConfig {
  int slots = 25;              ///< PL, max_instances.
  double semantic = 0.1;       ///< PL, lambda_sem.
  double segment = 0.12;       ///< PL, lambda_sem * lambda_segment.
  double instance = 1.0;       ///< PL, as its trainer has it.
  double instance_from = 0.3;  ///< Share of training (PL epoch 3 of 10).
  double segment_from = 0.6;   ///< PL epoch 6 of 10.
  double rate = 2.5e-3;        ///< Of logits (GG; PL's 5e-4 is for an MLP).
};

/// How features become instances.
struct DensityClusteringConfig {
  int points = 20000;       ///< Rendered pixels (ours; CL 50 000).
  double min_share = 0.01;  ///< Of the points: a smaller cluster is none (CL 500).
  int min_samples = 1;      ///< The density at a point reaches to this neighbour (CL).
};

/// Contrastive Lift on surfels.
struct ContrastiveLiftConfig {
  double instance = 1.0;        ///< CL.
  double semantic_from = 0.1;   ///< Share of training (CL epoch 1 of 10).
  double instance_from = 0.4;   ///< CL epoch 4 of 10.
  double segment_from = 0.7;    ///< CL epoch 7 of 10.
  int pixels = 2048;            ///< Of a step's masks, half of them slow (ours; CL 1024).
  double slow_momentum = 0.9;   ///< CL.
  double feature_noise = 0.01;  ///< Features begin as N(0, this) (ours).
  double rate = 1e-2;           ///< Of features (ours; CL's 5e-4 is for an MLP).
  DensityClusteringConfig clustering;
};

/// Where identities come from that hold in all views.
enum class IdentitySource : std::uint8_t {
  kAssociated,  ///< Objects that masks of several views agree on (mask_association.h).
  kAssigned,    ///< The optimal assignment of every step, as in Panoptic Lifting.
};

/// Gaussian Grouping on surfels.
struct GaussianGroupingConfig {
  IdentitySource identities = IdentitySource::kAssociated;
  int ids = 256;             ///< GG; 0 is "none".
  double identity = 1.0;     ///< Cross entropy / log(ids) (GG).
  double smoothness = 2.0;   ///< KL of neighbours / ids (GG, lambda of the 3-D term).
  int smoothness_every = 5;  ///< Iterations (GG).
  int smoothness_surfels = 1000, neighbours = 5;  ///< GG.
  double rate = 2e-2;             ///< Of identities (ours; GG 2.5e-3 in 30 000 iterations).
  double classifier_rate = 4e-3;  ///< Ours; GG 5e-4.
};

/// OpenGaussian on surfels.
struct OpenGaussianConfig {
  double coarse_from = 0.33, fine_from = 0.67;  ///< Shares (OG: three stages alike).
  double separation = 1.0, cohesion = 0.1;      ///< OG.
  double sharpen_from =
      0.08;                   ///< Share from which only near masks repel (OG 0.25 of a third).
  int coarse = 64, fine = 5;  ///< Entries of the codebook, fine ones of each coarse (OG).
  double position_weight = 1.0;  ///< Of metres beside features, coarse (OG).
  int rounds = 5;                ///< Of k-means when entries are assigned anew (OG) ...
  double coarse_every = 0.01, fine_every = 0.01;  ///< ... so often (ours; OG 200, 50 of
                                                  ///< 60 000: too dear in a short run).
  double max_variance = 6e-3;  ///< A mask whose features vary more teaches nothing ...
  double large_mask = 0.8;     ///< ... unless it is almost as large as the largest (OG).
  double rate = 1e-2;          ///< Of features (ours; OG 1e-3 in 60 000 iterations).
  int points = 100000;         ///< Rendered pixels that name the entries (ours).
  double min_score = 0.2;      ///< IoU times likeness of an entry and its mask (OG).
  double min_together = 0.5;  ///< Of the views: two entries in one mask are one object (ours).
};

/// PVLFF on surfels.
struct PvlffConfig {
  double language = 0.5;          ///< L1 distance of class features (PVLFF).
  double contrast = 0.1;          ///< InfoNCE (PVLFF) ...
  double centre = 0.5;            ///< ... and of it, the distance to a mask's centre (PVLFF).
  int groups = 2048;              ///< Anchors of a step (ours; PVLFF 32 for every 512 rays).
  int negatives = 14;             ///< Of an anchor (PVLFF).
  double temperature = 0.1;       ///< PVLFF.
  double centre_momentum = 0.95;  ///< Of an image's turn (PVLFF: of a refreshment).
  double feature_noise = 0.01;    ///< Instance features begin as N(0, this) (ours).
  double rate = 2e-2;             ///< Of features (ours; PVLFF 5e-3).
  /// Of all pixels (PVLFF: clusters of 100 of 200 000 points).
  DensityClusteringConfig clustering{.points = 20000, .min_share = 0.005, .min_samples = 100};
};

/// PanopticRecon on surfels. All numbers are ours.
struct PanopticReconConfig {
  int neighbours = 10;          ///< Of a surfel, ...
  double max_gap_m = 0.06;      ///< ... not farther than this, ...
  double max_angle_deg = 15.0;  ///< ... turned by no more from the first of its patch, ...
  double max_radius_m = 0.3;    ///< ... nor farther from it: small objects need patches.
  int min_surfels = 50;         ///< Of a patch.
  int pixels = 20000;           ///< Of a view, on a grid.
  double min_inside = 0.5;      ///< Of a patch's pixels in a mask, of a mask's in an object.
  int min_views = 3;            ///< An object has masks in so many views.
  double semantic = 1.0, instance = 1.0;
  double rate = 5e-3;  ///< Of logits.
};

/// PanopticRecon++ on surfels. What is not here it shares with the head of the paper
/// (QueryConfig, HeadRateConfig): sizes, rates of features of queries, the class's part of
/// matching costs.
struct PanopticReconPlusConfig {
  /// Of classes; of masks and classes of queries; of the panoptic map; of similar queries
  /// (PR++: 80, 30, 300, 100).
  double semantic = 2.67, instance = 1.0, panoptic = 10.0, repulsion = 3.33;
  /// Share of training from which on classes and Dice have ended (PR++: epoch 4 of 20).
  double panoptic_from = 0.2;
  bool unlabelled_negative = true;  ///< Unlabelled pixels are of no instance (PR++).
  double feature_rate = 1e-2;       ///< Of surfels (PR++, hash grids).
  double decoder_rate = 4e-3;       ///< Ours (PR++ 2e-4).
  double query_position_m = 0.02;   ///< PR++, 5e-3 in a scene of 4 m scaled to 1.
  double query_log_sigma = 1e-2;    ///< PR++.
  double final_factor = 0.36;       ///< Of rates, from the start on (PR++ 0.95^20).
  double initial_sigma_m = 1.0;     ///< PR++.
  double max_dice = 0.9;            ///< A match with a larger dice loss is none (PR++).
  double prune_from = 0.1, prune_every = 0.05;  ///< Shares (PR++ epoch 2 of 20, 300 of 6000).
  double overlap_score = 0.8;                   ///< PR++.
};

}  // namespace segsim::reconstruction
