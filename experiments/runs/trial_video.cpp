#include "experiments/runs/trial_video.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/internal/map_canvas.h"
#include "experiments/scenes/frame_picture.h"

namespace segsim::experiments {
namespace {

constexpr int kPaneHeight = 360;
constexpr int kCaptionHeight = 44;
constexpr int kGap = 6;

std::string caption_of(const TrialScene& scene, const sim::TickRecord& tick) {
  char time[32];
  std::snprintf(time, sizeof time, "%6.1f s", core::seconds(tick.time_ns));
  return scene.scene_title + "   find: " + scene.episode->class_name +
         "   detector: " + scene.arm + "   " + core::to_string(tick.mode) + "   " + time;
}

void draw_detections(cv::Mat& image, double scale, std::span<const core::Detection> detections,
                     const std::vector<std::string>& classes, int goal_index) {
  for (const core::Detection& d : detections) {
    const bool goal = d.class_index == goal_index;
    const cv::Scalar color = goal ? ink::kDetected : ink::kFaint;
    const cv::Rect box(static_cast<int>(scale * d.box.x0), static_cast<int>(scale * d.box.y0),
                       static_cast<int>(scale * d.box.width_px()),
                       static_cast<int>(scale * d.box.height_px()));
    cv::rectangle(image, box, color, goal ? 3 : 1, cv::LINE_AA);
    const auto index = static_cast<std::size_t>(d.class_index);
    char text[64];
    std::snprintf(text, sizeof text, "%s %.2f",
                  index < classes.size() ? classes[index].c_str() : "?",
                  static_cast<double>(d.score));
    const cv::Point2d at(box.x + 2.0, std::max(14.0, box.y - 4.0));
    draw_text(image, text, at, 10.0, cv::Scalar(255, 255, 255), true);
    draw_text(image, text, at, 10.0, color);
  }
}

/// Enlarges or reduces to the height of a pane.
cv::Mat to_pane(const cv::Mat& image) {
  cv::Mat pane;
  const double scale = static_cast<double>(kPaneHeight) / image.rows;
  cv::resize(image, pane, cv::Size(), scale, scale,
             scale < 1.0 ? cv::INTER_AREA : cv::INTER_CUBIC);
  return pane;
}

}  // namespace

struct TrialVideo::Impl {
  std::filesystem::path file, temporary;
  const TrialScene& scene;
  std::vector<std::string> classes;
  double frames_per_s;
  cv::VideoWriter writer;
  cv::Mat last;
  std::vector<sim::TickRecord> track;

  Impl(std::filesystem::path target, const TrialScene& of, std::vector<std::string> names,
       double rate)
      : file(std::move(target)), scene(of), classes(std::move(names)), frames_per_s(rate) {
    temporary = file.parent_path() /
                ("." + file.stem().string() + ".part" + file.extension().string());
  }

  void open(const cv::Size& size) {
    std::filesystem::create_directories(file.parent_path());
    for (const char* code : {"avc1", "mp4v", "MJPG"}) {
      const int fourcc = cv::VideoWriter::fourcc(code[0], code[1], code[2], code[3]);
      if (writer.open(temporary.string(), fourcc, frames_per_s, size)) return;
    }
    throw core::InputError::expected(file.string(), "a place and an encoder for a video",
                                     "none");
  }

  [[nodiscard]] cv::Mat map_pane(const core::PolicyView& view) const {
    const double scale = 2.0 * kPaneHeight / std::max(1, scene.plan->rgb.height_px());
    MapCanvas map(*scene.plan, scale);
    map.draw_knowledge(view);
    map.draw_goals(*scene.manifest, scene.episode->class_name);
    map.draw_frontiers(view);
    map.draw_target(view);
    map.draw_track(track);
    map.draw_objects(view, scene.goal_index);
    map.draw_start(scene.episode->start);
    map.draw_robot(track.back().pose, 1.2);
    return to_pane(map.image());
  }

  void write(const cv::Mat& page) {
    if (!writer.isOpened()) open(page.size());
    writer.write(page);
    last = page;
  }
};

TrialVideo::TrialVideo(std::filesystem::path file, const TrialScene& scene,
                       std::vector<std::string> detector_classes, double frames_per_s)
    : impl_(std::make_unique<Impl>(std::move(file), scene, std::move(detector_classes),
                                   frames_per_s)) {}

TrialVideo::~TrialVideo() {
  if (impl_->writer.isOpened()) {  // Not finished: leave nothing half done.
    impl_->writer.release();
    std::error_code ignored;
    std::filesystem::remove(impl_->temporary, ignored);
  }
}

void TrialVideo::add(const sim::TickRecord& tick, const core::Frame& frame,
                     std::span<const core::Detection> detections,
                     const core::PolicyView& view) {
  impl_->track.push_back(tick);
  cv::Mat camera = to_pane(to_bgr(frame.rgb));
  draw_detections(camera, static_cast<double>(kPaneHeight) / frame.rgb.height_px(), detections,
                  impl_->classes, impl_->scene.goal_index);
  std::vector<cv::Mat> panes{camera};
  if (!frame.semantic.empty()) panes.push_back(to_pane(to_bgr(panoptic_picture(frame))));
  panes.push_back(impl_->map_pane(view));

  int width = 0;
  for (const cv::Mat& pane : panes) width += pane.cols + (width == 0 ? 0 : kGap);
  // Encoders want even sizes.
  cv::Mat page(kCaptionHeight + kPaneHeight, width + width % 2, CV_8UC3,
               cv::Scalar(255, 255, 255));
  draw_text(page, caption_of(impl_->scene, tick), {12.0, 29.0}, 13.0, mode_color(tick.mode),
            true);
  int x = 0;
  for (const cv::Mat& pane : panes) {
    pane.copyTo(page(cv::Rect(x, kCaptionHeight, pane.cols, kPaneHeight)));
    x += pane.cols + kGap;
  }
  impl_->write(page);
}

void TrialVideo::finish(const sim::TrialResult& result) {
  if (impl_->last.empty()) return;
  cv::Mat page = impl_->last.clone();
  const cv::Scalar color = result.success ? ink::kGoal : ink::kRecover;
  page(cv::Rect(0, 0, page.cols, kCaptionHeight)).setTo(color);
  char text[128];
  std::snprintf(text, sizeof text, "%s   SPL %.2f   path %.1f m   %.0f s",
                sim::to_string(result.outcome), result.spl, result.path_m, result.sim_s);
  draw_text(page, text, {12.0, 29.0}, 13.0, cv::Scalar(255, 255, 255), true);
  for (int k = 0; k < static_cast<int>(2.0 * impl_->frames_per_s); ++k)
    impl_->writer.write(page);
  impl_->writer.release();
  std::error_code error;
  std::filesystem::rename(impl_->temporary, impl_->file, error);
  if (error)
    throw core::InputError::expected(impl_->file.string(), "a video", error.message());
}

}  // namespace segsim::experiments
