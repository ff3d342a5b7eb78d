#include "experiments/films/internal/pages.h"

#include <algorithm>
#include <utility>

#include <opencv2/imgcodecs.hpp>

#include "core/check.h"
#include "experiments/drawing/map_canvas.h"
#include "experiments/drawing/map_legend.h"

namespace segsim::experiments::films::internal {

PageSampler::PageSampler(video::internal::PageForm form, double step_s, Sink sink,
                         std::function<void()> on_tick)
    : form_(form), step_s_(step_s), sink_(std::move(sink)), on_tick_(std::move(on_tick)) {
  SEGSIM_CHECK(step_s > 0.0, "step_s");
}

void PageSampler::begin(const drawing::TrialScene& scene,
                        const std::vector<std::string>& detector_classes) {
  page_.emplace(scene, detector_classes, form_);
  next_s_ = 0.0;
  pages_ = 0;
}

void PageSampler::add(const sim::TickRecord& tick, const core::Frame& frame,
                      std::span<const core::Detection> detections,
                      const core::PolicyView& view) {
  constexpr double kRounding_s = 1e-6;
  const double time_s = core::seconds(tick.time_ns) + kRounding_s;
  if (pages_ == 0) next_s_ = core::seconds(tick.time_ns);  // The first image may be late.
  if (time_s < next_s_) {
    page_->pass(tick);
  } else {
    const cv::Mat page = page_->draw(tick, frame, detections, view);
    for (; next_s_ <= time_s; next_s_ += step_s_, ++pages_) sink_(page);
  }
  if (on_tick_) on_tick_();
}

void PageSampler::finish(const sim::TrialResult& result) {
  if (pages_ == 0) return;
  sink_(page_->draw_outcome(result));
  ++pages_;
}

void PageTape::push(const cv::Mat& page) {
  pages_.emplace_back();
  cv::imencode(".jpg", page, pages_.back(), {cv::IMWRITE_JPEG_QUALITY, 95});
}

cv::Mat PageTape::at(std::size_t index) const {
  SEGSIM_CHECK(!pages_.empty(), "a tape of no pages");
  return cv::imdecode(pages_[std::min(index, pages_.size() - 1)], cv::IMREAD_COLOR);
}

cv::Mat pair_screen(const std::string& title, const std::string& note, const cv::Mat& left,
                    const cv::Mat& right) {
  constexpr int kTop = 44;
  constexpr double kLegendScale = 0.72;
  cv::Mat screen(kScreenHeight_px, kScreenWidth_px, CV_8UC3, cv::Scalar(255, 255, 255));
  drawing::draw_text(screen, title, {6.0, 28.0}, 13.0, drawing::ink::kText, true);
  drawing::draw_text(screen, note,
                     {kScreenWidth_px - 8.0 - drawing::text_width_px(note, 11.0), 29.0}, 11.0,
                     drawing::ink::kFaint);
  left.copyTo(screen(cv::Rect(cv::Point(0, kTop), left.size())));
  right.copyTo(screen(cv::Rect(cv::Point(kScreenWidth_px - right.cols, kTop), right.size())));
  constexpr int kLegend_y = kTop + video::internal::kColumnHeight_px + 8;
  drawing::draw_map_legend(screen, {4, kLegend_y}, kScreenWidth_px, kLegendScale);
  return screen;
}

}  // namespace segsim::experiments::films::internal
