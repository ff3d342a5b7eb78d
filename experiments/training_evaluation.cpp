#include "experiments/training_evaluation.h"

#include <cstdio>
#include <numbers>

#include "core/check.h"
#include "core/progress.h"
#include "renderer/depth_normal.h"
#include "renderer/evaluation/semantic_quality.h"

namespace segsim::experiments {

std::vector<std::pair<std::string, double>> HeldOutQuality::listing(
    const std::string& prefix) const {
  if (color.views() == 0) return {};
  std::vector<std::pair<std::string, double>> list{
      {prefix + "views", static_cast<double>(color.views())},
      {prefix + "psnr_db", color.psnr_db()},
      {prefix + "ssim", color.ssim()},
      {prefix + "depth_l1_m", depth.mean_abs_m()},
      {prefix + "depth_completeness", depth.completeness()},
      {prefix + "normal_error_deg", normal.mean_rad() * 180.0 / std::numbers::pi}};
  if (labels.frame_count() > 0) {
    list.insert(list.end(), {{prefix + "strict_pq", panoptic.pq},
                             {prefix + "strict_sq", panoptic.sq},
                             {prefix + "strict_rq", panoptic.rq},
                             {prefix + "mean_iou", mean_iou}});
  }
  return list;
}

std::string HeldOutQuality::text() const {
  if (color.views() == 0) return "no held-out views";
  char line[256];
  int used = std::snprintf(line, sizeof line,
                           "%d held-out views: PSNR %.2f dB, SSIM %.3f, depth L1 %.1f cm "
                           "(%.1f %% covered), normals "
                           "%.1f deg",
                           color.views(), color.psnr_db(), color.ssim(),
                           100.0 * depth.mean_abs_m(), 100.0 * depth.completeness(),
                           normal.mean_rad() * 180.0 / std::numbers::pi);
  std::string text(line, static_cast<std::size_t>(used));
  if (labels.frame_count() > 0) {
    used = std::snprintf(line, sizeof line, ", strict PQ %.1f (SQ %.1f, RQ %.1f), mIoU %.1f",
                         100.0 * panoptic.pq, 100.0 * panoptic.sq, 100.0 * panoptic.rq,
                         100.0 * mean_iou);
    text.append(line, static_cast<std::size_t>(used));
  }
  return text;
}

HeldOutQuality held_out_quality(core::Renderer& renderer, const renderer::TrainingSet& set,
                                std::span<const core::CameraPose> poses) {
  SEGSIM_CHECK(poses.empty() || poses.size() == set.held_out.size(),
               std::to_string(poses.size()) + " poses");
  HeldOutQuality quality;
  core::Progress progress("held-out views", static_cast<std::int64_t>(set.held_out.size()));
  core::Frame frame;
  std::int64_t done = 0;
  for (const renderer::TrainingView& view : set.held_out) {
    const core::CameraPose T_world_camera =
        poses.empty() ? view.T_world_camera : poses[static_cast<std::size_t>(done)];
    renderer.render(T_world_camera, set.intrinsics, core::Channels::kAll, frame);
    quality.color.add(frame.rgb, view.rgb);
    if (!view.depth_m.empty()) {
      quality.depth.add(frame.depth_m, view.depth_m);
      quality.normal.add(
          frame.normal, renderer::depth_normals(view.depth_m, set.intrinsics, T_world_camera));
    }
    if (!view.masks.semantic.empty() && !frame.semantic.empty()) {
      quality.labels.add_frame({view.masks.semantic, view.masks.instance},
                               {frame.semantic, frame.instance});
    }
    progress.update(++done);
  }
  if (quality.labels.frame_count() > 0) {
    quality.panoptic = renderer::panoptic_quality(quality.labels, set.classes,
                                                  renderer::PanopticRules::strict());
    quality.mean_iou = renderer::semantic_quality(quality.labels, set.classes,
                                                  renderer::SemanticRules::pooled())
                           .mean_iou;
  }
  return quality;
}

}  // namespace segsim::experiments
