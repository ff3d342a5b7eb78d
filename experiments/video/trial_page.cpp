#include "experiments/video/trial_page.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <opencv2/imgproc.hpp>

#include "core/check.h"
#include "core/formatted.h"
#include "experiments/drawing/frame_picture.h"
#include "experiments/drawing/map_canvas.h"
#include "experiments/drawing/map_legend.h"

namespace segsim::experiments::video::internal {
namespace {

constexpr int kGap = 6, kCaption = 44, kStatus = 34;
constexpr int kWidePane = 360;        // Height.
constexpr int kWidestMap = 640;       // Of a wide page's pane.
constexpr double kTitle = 13.0;       // Thicker strokes from 13.5 on look smeared.
constexpr double kLetter = 12.0;      // Height of capitals.
constexpr double kSmallLetter = 8.0;  // Names of panes and boxes.
const cv::Scalar kWhite(255, 255, 255);

/// As large as fits, centred.
cv::Mat fit(const cv::Mat& image, const cv::Size& size) {
  const double scale = std::min(static_cast<double>(size.width) / image.cols,
                                static_cast<double>(size.height) / image.rows);
  const cv::Size to(
      std::clamp(static_cast<int>(std::lround(scale * image.cols)), 1, size.width),
      std::clamp(static_cast<int>(std::lround(scale * image.rows)), 1, size.height));
  cv::Mat scaled, pane(size, CV_8UC3, drawing::ink::kPaper);
  cv::resize(image, scaled, to, 0.0, 0.0, scale < 1.0 ? cv::INTER_AREA : cv::INTER_CUBIC);
  scaled.copyTo(pane(cv::Rect(cv::Point((size - to) / 2), to)));
  return pane;
}

/// What the pane shows, in its lower left corner.
void name_pane(cv::Mat& pane, const std::string& name) {
  const double width = drawing::text_width_px(name, kSmallLetter) + 12.0;
  cv::Mat ground = pane(cv::Rect(0, pane.rows - 18, static_cast<int>(width), 18));
  ground *= 0.35;
  drawing::draw_text(pane, name, {6.0, pane.rows - 5.0}, kSmallLetter, kWhite);
}

void draw_detection(cv::Mat& pane, const cv::Point2d& corner, double scale,
                    const core::Detection& d, const std::vector<std::string>& classes,
                    bool goal) {
  const cv::Scalar color = goal ? drawing::ink::kDetected : drawing::ink::kFaint;
  const cv::Rect box(static_cast<int>(corner.x + scale * d.box.x0),
                     static_cast<int>(corner.y + scale * d.box.y0),
                     static_cast<int>(scale * d.box.width_px()),
                     static_cast<int>(scale * d.box.height_px()));
  cv::rectangle(pane, box, color, goal ? 3 : 1, cv::LINE_AA);
  const auto index = static_cast<std::size_t>(d.class_index);
  const std::string text =
      core::print("%s %.2f", index < classes.size() ? classes[index].c_str() : "?",
                  static_cast<double>(d.score));
  drawing::draw_pill(pane, text, {box.x + 4.0, std::max(kSmallLetter + 6.0, box.y - 5.0)},
                     kSmallLetter, color);
}

std::string upper(std::string text) {
  for (char& c : text) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return text;
}

}  // namespace

TrialPage::TrialPage(const drawing::TrialScene& scene,
                     std::vector<std::string> detector_classes, PageForm form)
    : scene_(scene), classes_(std::move(detector_classes)), form_(form) {}

cv::Mat TrialPage::camera_pane(const core::Frame& frame,
                               std::span<const core::Detection> detections,
                               const cv::Size& size) const {
  cv::Mat pane = fit(drawing::to_bgr(frame.rgb), size);
  const double scale = std::min(static_cast<double>(size.width) / frame.rgb.width_px(),
                                static_cast<double>(size.height) / frame.rgb.height_px());
  const cv::Point2d corner(0.5 * (size.width - scale * frame.rgb.width_px()),
                           0.5 * (size.height - scale * frame.rgb.height_px()));
  // The goal's boxes lie over the others.
  for (const bool goal : {false, true}) {
    for (const core::Detection& d : detections) {
      if ((d.class_index == scene_.goal_index) == goal) {
        draw_detection(pane, corner, scale, d, classes_, goal);
      }
    }
  }
  name_pane(pane, "camera, detections");
  return pane;
}

cv::Mat TrialPage::map_pane(const core::PolicyView& view, const cv::Size& size) {
  if (!empty_map_) {
    const core::Image<core::Rgb8>& plan = scene_.plan->rgb;
    const double fitted =
        std::min(static_cast<double>(size.width) / std::max(1, plan.width_px()),
                 static_cast<double>(size.height) / std::max(1, plan.height_px()));
    constexpr double kOversampling = 2.0;  // Smooths lines.
    empty_map_.emplace(*scene_.plan, kOversampling * fitted);
  }
  drawing::MapCanvas map = empty_map_->clone();
  map.place_views(drawing::OdomPlacement(track_.back().pose, track_.back().estimate));
  map.draw_knowledge(view);
  map.draw_goals(*scene_.manifest, {*scene_.manifest, *scene_.episode});
  map.draw_view_points(scene_.episode->view_points_m);
  map.draw_shortest_path(scene_.shortest_path_m);
  map.draw_frontiers(view);
  map.draw_target(view);
  map.draw_track(track_);
  map.draw_objects(view, scene_.goal_index);
  map.draw_start(scene_.episode->start);
  map.draw_robot(track_.back().pose, 1.2);
  cv::Mat pane = fit(map.image(), size);
  name_pane(pane, "the robot's map");
  return pane;
}

void TrialPage::draw_status(cv::Mat& page, const cv::Point& corner, int width_px,
                            const sim::TickRecord& tick,
                            std::span<const core::Detection> detections) const {
  const double base = corner.y + 0.5 * (kStatus + kLetter);
  const double mode_end =
      drawing::draw_pill(page, upper(core::to_string(tick.mode)), {corner.x + 0.0, base},
                         kLetter, drawing::mode_color(tick.mode));
  std::string text =
      core::print("tick %zu    %.1f s", track_.size() - 1, core::seconds(tick.time_ns));
  if (scene_.distance_m) {
    const double distance_m = scene_.distance_m({tick.pose.x_m, tick.pose.y_m});
    text += std::isfinite(distance_m) ? core::print("    %.1f m to goal", distance_m)
                                      : std::string("    no way to goal");
  }
  float best = -1.0F;
  for (const core::Detection& d : detections) {
    if (d.class_index == scene_.goal_index) best = std::max(best, d.score);
  }
  if (best >= 0.0F) {
    text += "    sees a " + scene_.episode->class_name +
            core::print(": %.2f", static_cast<double>(best));
  }
  if (tick.in_contact) text += "    CONTACT";
  // Long lines get smaller letters.
  const double left = std::max(mode_end, corner.x + 130.0) + 14.0;
  double letter = kLetter;
  while (letter > 7.0 && left + drawing::text_width_px(text, letter) > corner.x + width_px)
    letter -= 0.5;
  drawing::draw_text(page, text, {left, base}, letter,
                     tick.in_contact ? drawing::ink::kRecover : drawing::ink::kText);
}

cv::Mat TrialPage::draw(const sim::TickRecord& tick, const core::Frame& frame,
                        std::span<const core::Detection> detections,
                        const core::PolicyView& view) {
  track_.push_back(tick);
  const bool wide = form_ == PageForm::kWide;
  // Panes of the camera keep its proportions.
  const double aspect = static_cast<double>(frame.rgb.width_px()) / frame.rgb.height_px();
  const int column_view = (kColumnWidth_px - kGap) / 2;
  const cv::Size seen =
      wide ? cv::Size(static_cast<int>(std::lround(kWidePane * aspect)), kWidePane)
           : cv::Size(column_view,
                      static_cast<int>(std::lround(column_view / std::max(1.2, aspect))));
  const double plan_aspect = static_cast<double>(scene_.plan->rgb.width_px()) /
                             std::max(1, scene_.plan->rgb.height_px());
  const int status_y = kCaption + seen.height;
  const cv::Size map =
      wide ? cv::Size(std::min(kWidestMap, static_cast<int>(kWidePane * plan_aspect)),
                      kWidePane)
           : cv::Size(kColumnWidth_px, kColumnHeight_px - status_y - kStatus);
  std::vector<cv::Mat> panes{camera_pane(frame, detections, seen)};
  if (!frame.semantic.empty()) {
    panes.push_back(fit(drawing::to_bgr(drawing::panoptic_picture(frame)), seen));
    name_pane(panes.back(), "labels of the scene");
  }
  const auto views = static_cast<int>(panes.size());
  cv::Mat page(wide ? cv::Size(views * (seen.width + kGap) + map.width, status_y + kStatus)
                    : cv::Size(kColumnWidth_px, kColumnHeight_px),
               CV_8UC3, kWhite);
  int x = 0;
  for (const cv::Mat& pane : panes) {
    pane.copyTo(page(cv::Rect(cv::Point(x, kCaption), pane.size())));
    x += pane.cols + kGap;
  }
  map_pane(view, map).copyTo(
      page(cv::Rect(wide ? cv::Point(x, kCaption) : cv::Point(0, status_y + kStatus), map)));
  const std::string arm = "detector: " + scene_.arm;
  if (wide) {
    const std::string title = "Find " + sim::with_article(scene_.episode->goal_name());
    drawing::draw_text(page, title, {12.0, 29.0}, kTitle, drawing::ink::kText, true);
    drawing::draw_text(page, scene_.scene_title + "  /  " + scene_.episode->id,
                       {30.0 + drawing::text_width_px(title, kTitle, true), 29.0}, kLetter,
                       drawing::ink::kFaint);
    drawing::draw_pill(page, arm,
                       {page.cols - drawing::text_width_px(arm, kLetter, true) - 30.0, 29.0},
                       kLetter, drawing::ink::kText);
  } else {
    drawing::draw_text(page, arm, {4.0, 29.0}, kTitle, drawing::ink::kText, true);
  }
  draw_status(page, {0, status_y}, page.cols, tick, detections);
  last_ = page;
  return page.clone();
}

cv::Mat TrialPage::draw_outcome(const sim::TrialResult& result) const {
  SEGSIM_CHECK(!last_.empty(), "a page comes before its outcome");
  cv::Mat page = last_.clone();
  page(cv::Rect(0, 0, page.cols, kCaption - 2))
      .setTo(result.success ? drawing::ink::kGoal : drawing::ink::kRecover);
  std::string text = drawing::outcome_words(result.outcome);
  if (form_ == PageForm::kColumn) text = scene_.arm + ": " + text;
  drawing::draw_text(page, text, {12.0, 28.0}, kTitle, kWhite, true);
  std::string figures = core::print("%.1f s", result.sim_s);
  if (result.success) {
    figures += core::print(", path %.1f m, SPL %.2f", result.path_m, result.spl);
  } else if (std::isfinite(result.distance_to_goal_m)) {
    figures += core::print(", %.1f m from the goal", result.distance_to_goal_m);
  }
  const double room = page.cols - 36.0 - drawing::text_width_px(text, kTitle, true);
  double letter = 10.0;
  while (letter > 7.0 && drawing::text_width_px(figures, letter) > room) letter -= 0.5;
  drawing::draw_text(page, figures,
                     {page.cols - 12.0 - drawing::text_width_px(figures, letter), 27.0},
                     letter, kWhite);
  return page;
}

}  // namespace segsim::experiments::video::internal
