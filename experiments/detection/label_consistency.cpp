#include "experiments/detection/label_consistency.h"

#include <algorithm>
#include <cmath>

#include "core/quantile.h"
#include "perception/evaluation/average_precision.h"

namespace segsim::experiments::detection {
namespace {

double quantile(const std::vector<double>& values, double share) {
  return core::quantile(values, share, core::Between::kLower);
}

/// Semantic ids of an instance's pixels, void left out.
using Votes = std::map<std::uint16_t, int>;

std::map<int, Votes> votes_of(const core::Frame& frame) {
  std::map<int, Votes> votes;
  for (std::size_t i = 0; i < frame.instance.size(); ++i) {
    const std::uint16_t instance = frame.instance.pixels()[i];
    const std::uint16_t semantic = frame.semantic.pixels()[i];
    if (instance != 0 && semantic != 0) ++votes[instance][semantic];
  }
  return votes;
}

}  // namespace

std::optional<core::BoxPx> projected_box(const core::SceneInstance& instance,
                                         const core::CameraPose& T_world_camera,
                                         const core::CameraIntrinsics& camera) {
  constexpr double kNearest_m = 0.05;
  const auto T_camera_world = T_world_camera.inverse();
  double x0 = camera.width_px, y0 = camera.height_px, x1 = 0.0, y1 = 0.0;
  for (int corner = 0; corner < 8; ++corner) {
    const core::Point<core::frame::World> p{
        {(corner & 1) != 0 ? instance.box_max_m.x : instance.box_min_m.x,
         (corner & 2) != 0 ? instance.box_max_m.y : instance.box_min_m.y,
         (corner & 4) != 0 ? instance.box_max_m.z : instance.box_min_m.z}};
    const glm::dvec3 q_m = (T_camera_world * p).xyz_m;
    if (q_m.z < kNearest_m) return std::nullopt;
    const glm::dvec2 px = camera.project(q_m);
    x0 = std::min(x0, px.x);
    y0 = std::min(y0, px.y);
    x1 = std::max(x1, px.x);
    y1 = std::max(y1, px.y);
  }
  x0 = std::max(x0, 0.0);
  y0 = std::max(y0, 0.0);
  x1 = std::min(x1, static_cast<double>(camera.width_px));
  y1 = std::min(y1, static_cast<double>(camera.height_px));
  if (x1 <= x0 || y1 <= y0) return std::nullopt;
  return core::BoxPx{static_cast<float>(x0), static_cast<float>(y0), static_cast<float>(x1),
                     static_cast<float>(y1)};
}

void LabelConsistency::add(const core::Frame& frame,
                           const std::vector<perception::LabeledBox>& boxes) {
  const std::map<int, Votes> votes = votes_of(frame);
  for (const perception::LabeledBox& box : boxes) {
    if (!box.instance_id) continue;
    const auto* instance =
        manifest_.find_instance(static_cast<std::uint16_t>(*box.instance_id));
    if (instance == nullptr) continue;
    Record& record = records_[*box.instance_id];
    ++record.views;
    if (box.ignore) ++record.ignored_views;
    if (const auto found = votes.find(*box.instance_id); found != votes.end()) {
      int own = 0, all = 0, most_other = 0;
      for (const auto& [semantic, count] : found->second) {
        all += count;
        if (semantic == instance->class_id) {
          own = count;
        } else {
          most_other = std::max(most_other, count);
        }
      }
      record.pixels += all;
      record.own_pixels += own;
      if (most_other > own) ++record.differing_views;
    }
    if (box.truncated || box.occluded || box.ignore) continue;
    const auto expected = projected_box(*instance, frame.T_world_camera, frame.intrinsics);
    if (!expected) continue;
    record.overlaps.push_back(perception::region_overlap(perception::region_of(box.box),
                                                         perception::region_of(*expected)));
    record.ratios.push_back(
        std::sqrt(double{box.box.area_px2()} / double{expected->area_px2()}));
  }
}

std::vector<InstanceConsistency> LabelConsistency::result() const {
  std::vector<InstanceConsistency> result;
  for (const auto& [id, record] : records_) {
    const auto* instance = manifest_.find_instance(static_cast<std::uint16_t>(id));
    InstanceConsistency c;
    c.scene = manifest_.name;
    c.name = instance->name;
    c.class_name = manifest_.class_name(instance->class_id);
    c.instance_id = id;
    c.views = record.views;
    c.ignored_views = record.ignored_views;
    c.differing_views = record.differing_views;
    if (record.pixels > 0) {
      c.label_agreement =
          static_cast<double>(record.own_pixels) / static_cast<double>(record.pixels);
    }
    c.whole_views = static_cast<int>(record.ratios.size());
    if (!record.ratios.empty()) {
      c.extent_overlap = quantile(record.overlaps, 0.5);
      c.size_ratio = quantile(record.ratios, 0.5);
      c.size_ratio_spread = quantile(record.ratios, 0.75) - quantile(record.ratios, 0.25);
    }
    result.push_back(std::move(c));
  }
  return result;
}

}  // namespace segsim::experiments::detection
