#include "experiments/drawing/trial_picture.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include <opencv2/imgproc.hpp>

#include "experiments/drawing/map_canvas.h"
#include "experiments/drawing/map_legend.h"

namespace segsim::experiments::drawing {
namespace {

constexpr int kOversampling = 2;
// Sizes in pixels of the finished picture, times the oversampling.
constexpr int kMargin = 24 * kOversampling;
constexpr int kHeader = 92 * kOversampling;
constexpr int kMinWidth = 760 * kOversampling;

std::string print(const char* format, double value) {
  char text[48];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::string figures(const sim::TrialResult& result) {
  std::string text = "SPL " + print("%.2f", result.spl) + "    path " +
                     print("%.1f", result.path_m) + " m (shortest " +
                     print("%.1f", result.shortest_path_m) + " m)    " +
                     print("%.0f", result.sim_s) + " s";
  if (std::isfinite(result.distance_to_goal_m)) {
    text += "    " + print("%.1f", result.distance_to_goal_m) + " m to goal";
  }
  if (result.contacts > 0) text += "    contacts " + std::to_string(result.contacts);
  return text;
}

void draw_header(cv::Mat& image, const TrialScene& scene, const sim::TrialResult& result) {
  const double title_px = 19.0 * kOversampling, text_px = 12.0 * kOversampling;
  const double base_1 = kMargin + title_px;
  const double base_2 = base_1 + 40.0 * kOversampling;
  const std::string title = "Find " + sim::with_article(scene.episode->goal_name());
  draw_text(image, title, {1.0 * kMargin, base_1}, title_px, ink::kText, true);
  draw_text(image, scene.scene_title + "  /  " + scene.episode->id,
            {kMargin + text_width_px(title, title_px, true) + 18.0 * kOversampling, base_1},
            text_px, ink::kFaint);
  const std::string arm = "detector: " + scene.arm;
  const double arm_px = text_width_px(arm, text_px, true) + 1.4 * text_px;
  draw_pill(image, arm, {image.cols - kMargin - arm_px, base_1}, text_px, ink::kText);

  const cv::Scalar color = result.success ? ink::kGoal : ink::kRecover;
  const std::string why = scene.cause.empty() ? std::string() : ": " + scene.cause;
  const double end = draw_pill(image, outcome_words(result.outcome) + why,
                               {1.0 * kMargin, base_2}, text_px, color);
  draw_text(image, figures(result), {end + 14.0 * kOversampling, base_2}, text_px, ink::kText);
}

}  // namespace

core::Image<core::Rgb8> draw_trial(const TrialScene& scene, const sim::TrialResult& result,
                                   int long_side_px) {
  const FloorPlan& plan = *scene.plan;
  const int plan_side = std::max(plan.rgb.width_px(), plan.rgb.height_px());
  MapCanvas map(plan, static_cast<double>(kOversampling) * long_side_px / plan_side);
  map.place_views(OdomPlacement(result.final_pose, result.final_estimate));
  map.draw_knowledge(result.final_view);
  map.draw_goals(*scene.manifest, {*scene.manifest, *scene.episode});
  map.draw_view_points(scene.episode->view_points_m);
  map.draw_shortest_path(scene.shortest_path_m);
  map.draw_frontiers(result.final_view);
  map.draw_track(result.track);
  map.draw_objects(result.final_view, scene.goal_index);
  map.draw_start(scene.episode->start);
  if (!result.track.empty()) map.draw_robot(result.track.back().pose, 0.0);
  for (const TrialMark& mark : scene.marks) map.draw_mark(mark.position_m, mark.text);
  map.draw_scale_bar();

  const int width = std::max(kMinWidth, map.image().cols + 2 * kMargin);
  const int legend_width = width - kMargin - kMargin / 2;
  const int legend_px = map_legend_height_px(legend_width, kOversampling);
  const int height =
      kMargin + kHeader + map.image().rows + kMargin / 2 + legend_px + kMargin / 2;
  cv::Mat page(height, width, CV_8UC3, cv::Scalar(255, 255, 255));
  draw_header(page, scene, result);
  const cv::Rect place((width - map.image().cols) / 2, kMargin + kHeader, map.image().cols,
                       map.image().rows);
  map.image().copyTo(page(place));
  cv::rectangle(page, place, ink::kFaint, kOversampling);
  draw_map_legend(page, {kMargin, kMargin + kHeader + map.image().rows + kMargin / 2},
                  legend_width, kOversampling);

  cv::Mat reduced;
  cv::resize(page, reduced, cv::Size(width / kOversampling, height / kOversampling), 0, 0,
             cv::INTER_AREA);
  return from_bgr(reduced);
}

}  // namespace segsim::experiments::drawing
