#include "reconstruction/training/training_evaluation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>

#include <glm/common.hpp>

#include "core/check.h"
#include "core/progress.h"
#include "reconstruction/evaluation/depth_repeatability.h"
#include "reconstruction/evaluation/semantic_quality.h"
#include "renderer/scene/depth_normal.h"

namespace segsim::reconstruction {
namespace {

/// The first training view after a frame.
auto training_view_after(const TrainingSet& set, std::size_t frame) {
  return std::upper_bound(
      set.training.begin(), set.training.end(), frame,
      [](std::size_t at, const TrainingView& other) { return at < other.frame; });
}

/// What the training frames just before and after a view say about it, and what was drawn.
void add_sensor_level(const TrainingSet& set, const TrainingView& view,
                      const core::Image<float>& drawn_m, HeldOutQuality& quality) {
  const auto after = training_view_after(set, view.frame);
  const auto add = [&](const TrainingView& other) {
    if (other.depth_m.empty()) return;
    const core::Image<float> measured_m = reprojected_depth(
        other.depth_m, set.intrinsics, other.T_world_camera, view.T_world_camera);
    core::Image<float> drawn_there_m = drawn_m;
    for (std::size_t i = 0; i < drawn_m.size(); ++i) {
      if (!(measured_m.data()[i] > 0.0F)) {
        drawn_there_m.data()[i] = std::numeric_limits<float>::quiet_NaN();
      }
    }
    quality.sensor_depth.add(measured_m, view.depth_m);
    quality.depth_at_sensor.add(drawn_there_m, view.depth_m);
  };
  if (after != set.training.begin()) add(*std::prev(after));
  if (after != set.training.end()) add(*after);
}

}  // namespace

std::vector<std::pair<std::string, double>> HeldOutQuality::listing(
    const std::string& prefix) const {
  if (color.views() == 0) return {};
  std::vector<std::pair<std::string, double>> list{
      {prefix + "views", static_cast<double>(color.views())},
      {prefix + "psnr_db", color.psnr_db()},
      {prefix + "gain_fitted_psnr_db", gain_fitted_color.psnr_db()},
      {prefix + "ssim", color.ssim()},
      {prefix + "depth_l1_m", depth.mean_abs_m()},
      {prefix + "depth_median_m", depth.median_abs_m()},
      {prefix + "sensor_depth_l1_m", sensor_depth.mean_abs_m()},
      {prefix + "sensor_depth_median_m", sensor_depth.median_abs_m()},
      {prefix + "depth_l1_at_sensor_m", depth_at_sensor.mean_abs_m()},
      {prefix + "depth_median_at_sensor_m", depth_at_sensor.median_abs_m()},
      {prefix + "depth_completeness", depth.completeness()},
      {prefix + "normal_error_deg", normal.mean_rad() * 180.0 / std::numbers::pi}};
  if (exposed_color.views() > 0) {
    list.emplace_back(prefix + "neighbour_exposure_psnr_db", exposed_color.psnr_db());
  }
  if (labels.frame_count() > 0) {
    list.insert(list.end(), {{prefix + "strict_pq", panoptic.pq},
                             {prefix + "strict_sq", panoptic.sq},
                             {prefix + "strict_rq", panoptic.rq},
                             {prefix + "mean_iou", mean_iou}});
  }
  return list;
}

std::vector<core::MeasuredValue> HeldOutQuality::measured(const std::string& case_name) const {
  std::vector<core::MeasuredValue> values;
  const auto add = [&](const char* name, const char* unit, double value) {
    // The PSNR of equal pictures is infinite.
    if (std::isfinite(value)) values.push_back({case_name, name, unit, value});
  };
  if (color.views() > 0) {
    add("held-out views", "", color.views());
    add("PSNR", "dB", color.psnr_db());
    add("PSNR with a fitted gain", "dB", gain_fitted_color.psnr_db());
    add("SSIM", "", color.ssim());
  }
  if (exposed_color.views() > 0) {
    add("PSNR at the exposure of the frames before and after", "dB", exposed_color.psnr_db());
  }
  if (depth.pixels() > 0) {
    add("depth L1", "cm", 100.0 * depth.mean_abs_m());
    add("depth L1, median", "cm", 100.0 * depth.median_abs_m());
    add("depth RMS", "cm", 100.0 * depth.rms_m());
    add("depth, relative error", "%", 100.0 * depth.mean_relative());
    add("depth within a factor of 1.25", "%", 100.0 * depth.within_1_25());
    add("depth covered", "%", 100.0 * depth.completeness());
    add("normals", "deg", normal.mean_rad() * 180.0 / std::numbers::pi);
    const std::array<double, 3> within = normal.within();
    add("normals within 11.25 deg", "%", 100.0 * within[0]);
    add("normals within 22.5 deg", "%", 100.0 * within[1]);
    add("normals within 30 deg", "%", 100.0 * within[2]);
  }
  if (sensor_depth.pixels() > 0) {
    add("depth L1 where the next frames have it", "cm", 100.0 * depth_at_sensor.mean_abs_m());
    add("the next frames' own depth L1", "cm", 100.0 * sensor_depth.mean_abs_m());
  }
  if (labels.frame_count() > 0) {
    add("PQ", "", 100.0 * panoptic.pq);
    add("SQ", "", 100.0 * panoptic.sq);
    add("RQ", "", 100.0 * panoptic.rq);
    add("mIoU", "", 100.0 * mean_iou);
  }
  return values;
}

std::string HeldOutQuality::text() const {
  if (color.views() == 0) return "no held-out views";
  char line[256];
  int used = std::snprintf(line, sizeof line, "%d held-out views: PSNR %.2f dB, SSIM %.3f",
                           color.views(), color.psnr_db(), color.ssim());
  std::string text(line, static_cast<std::size_t>(used));
  if (depth.pixels() > 0) {  // Recordings without depth have nothing to compare with.
    used = std::snprintf(line, sizeof line,
                         ", depth L1 %.1f cm (%.1f %% covered), normals %.1f deg",
                         100.0 * depth.mean_abs_m(), 100.0 * depth.completeness(),
                         normal.mean_rad() * 180.0 / std::numbers::pi);
    text.append(line, static_cast<std::size_t>(used));
  }
  if (exposed_color.views() > 0) {
    used = std::snprintf(line, sizeof line,
                         ", PSNR at the exposure of the frames before and after %.2f dB",
                         exposed_color.psnr_db());
    text.append(line, static_cast<std::size_t>(used));
  }
  if (sensor_depth.pixels() > 0) {
    used =
        std::snprintf(line, sizeof line,
                      ", PSNR with a fitted gain per view %.2f dB, depth where the next "
                      "frames have it: L1 %.1f cm, median %.1f cm (their own: %.1f, %.1f)",
                      gain_fitted_color.psnr_db(), 100.0 * depth_at_sensor.mean_abs_m(),
                      100.0 * depth_at_sensor.median_abs_m(),
                      100.0 * sensor_depth.mean_abs_m(), 100.0 * sensor_depth.median_abs_m());
    text.append(line, static_cast<std::size_t>(used));
  }
  if (labels.frame_count() > 0) {
    used = std::snprintf(line, sizeof line, ", strict PQ %.1f (SQ %.1f, RQ %.1f), mIoU %.1f",
                         100.0 * panoptic.pq, 100.0 * panoptic.sq, 100.0 * panoptic.rq,
                         100.0 * mean_iou);
    text.append(line, static_cast<std::size_t>(used));
  }
  return text;
}

Exposure exposure_between(const TrainingSet& set, const std::vector<Exposure>& exposures,
                          std::size_t frame) {
  SEGSIM_CHECK(!exposures.empty() && exposures.size() == set.training.size(),
               std::to_string(exposures.size()) + " exposures");
  const auto index =
      static_cast<std::size_t>(training_view_after(set, frame) - set.training.begin());
  if (index == 0) return exposures.front();
  if (index == exposures.size()) return exposures.back();
  const Exposure &before = exposures[index - 1], &after = exposures[index];
  const std::size_t begin = set.training[index - 1].frame;
  const auto share =
      static_cast<float>(static_cast<double>(frame - begin) /
                         static_cast<double>(set.training[index].frame - begin));
  return {glm::mix(before.gain, after.gain, share),
          glm::mix(before.offset, after.offset, share)};
}

HeldOutQuality held_out_quality(core::Renderer& renderer, const TrainingSet& set,
                                const TrainedCamera& camera) {
  const std::vector<core::CameraPose>& poses = camera.held_out_poses;
  SEGSIM_CHECK(poses.empty() || poses.size() == set.held_out.size(),
               std::to_string(poses.size()) + " poses");
  HeldOutQuality quality;
  core::Progress progress("held-out views", static_cast<std::int64_t>(set.held_out.size()));
  core::Frame frame;
  std::int64_t done = 0;
  for (const TrainingView& view : set.held_out) {
    const core::CameraPose T_world_camera =
        poses.empty() ? view.T_world_camera : poses[static_cast<std::size_t>(done)];
    renderer.render(T_world_camera, set.intrinsics, core::Channels::kAll, frame);
    quality.color.add(frame.rgb, view.rgb);
    quality.gain_fitted_color.add(gain_fitted(frame.rgb, view.rgb), view.rgb);
    if (!camera.exposures.empty()) {
      const auto exposure = exposure_between(set, camera.exposures, view.frame);
      quality.exposed_color.add(exposed(frame.rgb, exposure), view.rgb);
    }
    if (!view.depth_m.empty()) {
      quality.depth.add(frame.depth_m, view.depth_m);
      quality.normal.add(
          frame.normal, renderer::depth_normals(view.depth_m, set.intrinsics, T_world_camera));
      add_sensor_level(set, view, frame.depth_m, quality);
    }
    if (!view.masks.semantic.empty() && !frame.semantic.empty()) {
      quality.labels.add_frame(images_of(view.masks), {frame.semantic, frame.instance});
    }
    progress.update(++done);
  }
  if (quality.labels.frame_count() > 0) {
    quality.panoptic = panoptic_quality(quality.labels, set.classes, PanopticRules::strict());
    quality.mean_iou =
        semantic_quality(quality.labels, set.classes, SemanticRules::pooled()).mean_iou;
  }
  return quality;
}

ContingencyTable trajectory_labels(
    core::Renderer& renderer, const TrainingSet& set,
    const std::function<core::FrameMasks(const TrainingView&)>& truth) {
  ContingencyTable table;
  core::Progress progress("training trajectory",
                          static_cast<std::int64_t>(set.training.size()));
  core::Frame frame;
  for (const TrainingView& view : set.training) {
    renderer.render(view.T_world_camera, set.intrinsics, core::Channels::kLabels, frame);
    const core::FrameMasks masks = truth(view);
    table.add_frame(images_of(masks), {frame.semantic, frame.instance});
    progress.update(static_cast<std::int64_t>(table.frame_count()));
  }
  return table;
}

}  // namespace segsim::reconstruction
