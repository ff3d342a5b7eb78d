#include "experiments/report/filmstrip.h"

#include <algorithm>

#include <opencv2/imgproc.hpp>

#include "core/check.h"
#include "core/formatted.h"
#include "experiments/drawing/box_picture.h"
#include "experiments/drawing/frame_picture.h"
#include "experiments/drawing/goal_boxes.h"
#include "experiments/drawing/map_canvas.h"
#include "experiments/results/explanation.h"

namespace segsim::experiments::report {
namespace {

constexpr int kPaneWidth = 240, kPaneHeight = 180, kCaption = 40, kGap = 4;

/// Fitted into a pane, centred.
cv::Mat to_pane(const cv::Mat& image) {
  const double scale = std::min(static_cast<double>(kPaneWidth) / image.cols,
                                static_cast<double>(kPaneHeight) / image.rows);
  const cv::Size size(std::max(1, static_cast<int>(scale * image.cols)),
                      std::max(1, static_cast<int>(scale * image.rows)));
  cv::Mat small;
  cv::resize(image, small, size, 0, 0, scale < 1.0 ? cv::INTER_AREA : cv::INTER_LINEAR);
  cv::Mat pane(kPaneHeight, kPaneWidth, CV_8UC3, drawing::ink::kPaper);
  small.copyTo(pane(cv::Rect((kPaneWidth - size.width) / 2, (kPaneHeight - size.height) / 2,
                             size.width, size.height)));
  return pane;
}

/// Part of the floor that the trial is about, with the pane's proportions [m].
struct Extent {
  glm::dvec2 low_m, size_m;
};

Extent extent_of(const records::TrialLog& log) {
  constexpr double kMargin_m = 1.0, kLeast_m = 5.0;
  glm::dvec2 low(log.episode.start.x_m, log.episode.start.y_m), high = low;
  const auto add = [&](const glm::dvec2& p_m) {
    low = glm::min(low, p_m);
    high = glm::max(high, p_m);
  };
  for (const sim::TickRecord& tick : log.track) add({tick.pose.x_m, tick.pose.y_m});
  for (const glm::dvec2& p_m : log.shortest_path_m) add(p_m);
  const glm::dvec2 centre = 0.5 * (low + high);
  glm::dvec2 size = glm::max(high - low + 2.0 * kMargin_m, glm::dvec2(kLeast_m));
  constexpr double kAspect = static_cast<double>(kPaneWidth) / kPaneHeight;
  size = {std::max(size.x, size.y * kAspect), std::max(size.y, size.x / kAspect)};
  return {centre - 0.5 * size, size};
}

cv::Mat map_pane(const records::TrialLog& log, const core::SceneManifest& manifest,
                 const drawing::FloorPlan& plan, int tick) {
  constexpr double kOversampling = 2.0;   // Smooths thin lines.
  constexpr double kMostPixels = 3000.0;  // Of the whole floor's longer side.
  const Extent extent = extent_of(log);
  const double scale =
      std::min(kOversampling * kPaneWidth / (extent.size_m.x * plan.px_per_m),
               kMostPixels / std::max(plan.rgb.width_px(), plan.rgb.height_px()));
  drawing::MapCanvas map(plan, scale);
  map.draw_goals(manifest, {manifest, log.episode});
  map.draw_shortest_path(log.shortest_path_m);
  map.draw_track(std::span(log.track).first(static_cast<std::size_t>(tick) + 1));
  map.draw_start(log.episode.start);
  map.draw_robot(log.track[static_cast<std::size_t>(tick)].pose, 0.0);
  const glm::dvec2 corner_px =
      plan.to_px(extent.low_m + glm::dvec2(0.0, extent.size_m.y)) * scale;
  const cv::Rect wanted(static_cast<int>(corner_px.x), static_cast<int>(corner_px.y),
                        static_cast<int>(extent.size_m.x * plan.px_per_m * scale),
                        static_cast<int>(extent.size_m.y * plan.px_per_m * scale));
  const cv::Rect there = wanted & cv::Rect(0, 0, map.image().cols, map.image().rows);
  if (there.empty()) return to_pane(map.image());
  cv::Mat part(wanted.size(), CV_8UC3, drawing::ink::kPaper);
  map.image()(there).copyTo(part(there - wanted.tl()));
  return to_pane(part);
}

/// The moments, with the start before them.
std::vector<results::KeyMoment> moments_of(const records::TrialRow& trial,
                                           const records::TrialLog& log) {
  std::vector<results::KeyMoment> moments = results::key_moments(trial, log);
  if (moments.empty() || moments.front().tick > 0) {
    moments.insert(moments.begin(), results::KeyMoment{0, "start"});
  }
  return moments;
}

/// What happened, in as many lines as fit.
void draw_caption(cv::Mat& page, int x, const std::string& time, const std::string& what) {
  constexpr double kLetter = 9.0;
  drawing::draw_text(page, time, {x + 4.0, 14.0}, kLetter, drawing::ink::kText, true);
  const double left = x + 10.0 + drawing::text_width_px(time, kLetter, true);
  const std::size_t comma = what.find(", ");
  drawing::draw_text(page, what.substr(0, comma), {left, 14.0}, kLetter, drawing::ink::kText);
  if (comma != std::string::npos) {
    drawing::draw_text(page, what.substr(comma + 2), {x + 4.0, 32.0}, kLetter,
                       drawing::ink::kText);
  }
}

}  // namespace

core::Image<core::Rgb8> draw_filmstrip(const records::TrialRow& trial,
                                       const records::TrialLog& log,
                                       const core::SceneManifest& manifest,
                                       const drawing::FloorPlan& plan,
                                       core::Renderer& renderer) {
  SEGSIM_CHECK(!log.track.empty(), trial.episode);
  const sim::GoalObjects goal(manifest, log.episode);
  const auto T_robot_camera =
      core::mast_camera(log.camera_height_m, log.camera_pitch_down_rad);
  const std::vector<results::KeyMoment> moments = moments_of(trial, log);
  const auto columns = static_cast<int>(moments.size());
  cv::Mat page(kCaption + 3 * kPaneHeight + 2 * kGap, columns * (kPaneWidth + kGap) - kGap,
               CV_8UC3, cv::Scalar(255, 255, 255));
  core::Frame frame;
  int x = 0;
  for (const results::KeyMoment& moment : moments) {
    const sim::TickRecord& tick = log.track[static_cast<std::size_t>(moment.tick)];
    renderer.render(core::transform_from_pose2<core::frame::World>(tick.pose) * T_robot_camera,
                    log.camera, core::Channels::kRgb | core::Channels::kLabels, frame);
    std::vector<core::Detection> detections;
    for (const records::JudgedDetection& d : log.detections) {
      if (d.tick == moment.tick) detections.push_back({0, d.score, d.box});
    }
    const double scale = static_cast<double>(kPaneWidth) / log.camera.width_px;
    const core::Image<core::Rgb8> seen =
        drawing::draw_boxes(frame.rgb, drawing::goal_boxes(frame, goal), detections,
                            {log.episode.goal_name()}, scale);
    draw_caption(page, x, core::print("%.1f s", core::seconds(tick.time_ns)), moment.what);
    const cv::Mat panes[] = {to_pane(drawing::to_bgr(seen)),
                             to_pane(drawing::to_bgr(drawing::panoptic_picture(frame))),
                             map_pane(log, manifest, plan, moment.tick)};
    int y = kCaption;
    for (const cv::Mat& pane : panes) {
      pane.copyTo(page(cv::Rect(x, y, kPaneWidth, kPaneHeight)));
      y += kPaneHeight + kGap;
    }
    x += kPaneWidth + kGap;
  }
  return drawing::from_bgr(page);
}

}  // namespace segsim::experiments::report
