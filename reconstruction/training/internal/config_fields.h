#pragma once

/// @file
/// The keys of the training configuration, once: reading, writing and checking walk this list.

#include <cstdint>

#include "reconstruction/labels/panoptic_config_fields.h"
#include "reconstruction/training/training_config.h"

namespace segsim::reconstruction::internal {

/// As in panoptic_config_fields.h.
template <class Visitor>
void visit_geometry(GeometryConfig& g, Visitor& v) {
  v.enter("geometry");
  v.integer("iterations", g.iterations, 0, 10'000'000);
  v.integer("sh_degree", g.sh_degree, 0, 3);
  v.number("sh_grow_every", g.sh_grow_every, 0.0, 1.0);
  v.enter("loss");
  v.number("ssim", g.loss.ssim, 0.0, 1.0);
  v.number("depth", g.loss.depth, 0.0, kNoLimit);
  v.number("normal", g.loss.normal, 0.0, kNoLimit);
  v.number("distortion", g.loss.distortion, 0.0, kNoLimit);
  v.number("plane", g.loss.plane, 0.0, kNoLimit);
  v.number("plane_truncation_m", g.loss.plane_truncation_m, 1e-6, kNoLimit);
  v.number("normal_from", g.loss.normal_from, 0.0, 1.0);
  v.number("distortion_from", g.loss.distortion_from, 0.0, 1.0);
  v.number("min_depth_m", g.loss.min_depth_m, 0.0, kNoLimit);
  v.number("max_depth_m", g.loss.max_depth_m, 0.0, kNoLimit);
  v.leave();
  v.enter("rate");
  v.number("position", g.rate.position, 0.0, 1.0);
  v.number("position_final", g.rate.position_final, 0.0, 1.0);
  v.number("color", g.rate.color, 0.0, 1.0);
  v.number("color_rest", g.rate.color_rest, 0.0, 1.0);
  v.number("opacity", g.rate.opacity, 0.0, 1.0);
  v.number("log_scale", g.rate.log_scale, 0.0, 1.0);
  v.number("rotation", g.rate.rotation, 0.0, 1.0);
  v.number("exposure", g.rate.exposure, 0.0, 1.0);
  v.number("pose_rotation", g.rate.pose_rotation, 0.0, 1.0);
  v.number("pose_translation", g.rate.pose_translation, 0.0, 1.0);
  v.leave();
  v.enter("densify");
  v.number("from", g.densify.from, 0.0, 1.0);
  v.number("until", g.densify.until, 0.0, 1.0);
  v.number("every", g.densify.every, 1e-6, 1.0);
  v.number("min_gradient", g.densify.min_gradient, 0.0, kNoLimit);
  v.number("max_growth", g.densify.max_growth, 0.0, 1.0);
  v.integer("max_surfels", g.densify.max_surfels, 1, 100'000'000);
  v.number("min_scale_m", g.densify.min_scale_m, 0.0, kNoLimit);
  v.number("min_opacity", g.densify.min_opacity, 0.0, 1.0);
  v.number("min_weight", g.densify.min_weight, 0.0, 1.0);
  v.number("max_scale_extent", g.densify.max_scale_extent, 0.0, kNoLimit);
  v.number("prune_until", g.densify.prune_until, 0.0, 1.0);
  v.flag("fill_holes", g.densify.fill_holes);
  v.leave();
  v.leave();
}

template <class Visitor>
void visit_fields(TrainingConfig& config, Visitor& v) {
  visit_geometry(config.geometry, v);
  visit_panoptic(config.panoptic, v);
  v.enter("joint");
  v.number("labels", config.joint.labels, 0.0, kNoLimit);
  v.number("rate", config.joint.rate, 0.0, kNoLimit);
  v.leave();
}

}  // namespace segsim::reconstruction::internal
