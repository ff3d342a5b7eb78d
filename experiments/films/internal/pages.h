#pragma once

/// @file
/// The pages of a trial one after another, and two such rows beside each other.

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "experiments/trials/trial_viewer.h"
#include "experiments/video/trial_page.h"

namespace segsim::experiments::films::internal {

/// Size of pairs, and of the cards between them.
inline constexpr int kScreenWidth_px = 1280, kScreenHeight_px = 720;

/// Draws pages at equal steps of simulated time, the last of them with the outcome.
class PageSampler final : public trials::TrialViewer {
 public:
  using Sink = std::function<void(const cv::Mat& page)>;
  /// @param step_s  Simulated time from one page to the next. A tick longer than that is shown
  /// several times, of shorter ones the first in each step.
  /// @param on_tick  Called once per tick; may be empty.
  PageSampler(video::internal::PageForm form, double step_s, Sink sink,
              std::function<void()> on_tick);

  void begin(const drawing::TrialScene& scene,
             const std::vector<std::string>& detector_classes) override;
  void add(const sim::TickRecord& tick, const core::Frame& frame,
           std::span<const core::Detection> detections, const core::PolicyView& view) override;
  /// A trial that ended before its first image has no page.
  void finish(const sim::TrialResult& result) override;

  [[nodiscard]] int pages() const { return pages_; }

 private:
  video::internal::PageForm form_;
  double step_s_, next_s_ = 0.0;
  Sink sink_;
  std::function<void()> on_tick_;
  std::optional<video::internal::TrialPage> page_;
  int pages_ = 0;
};

/// Pages kept in memory as JPEG of high quality: some 0.1 MB each.
class PageTape {
 public:
  void push(const cv::Mat& page);
  [[nodiscard]] bool empty() const { return pages_.empty(); }
  [[nodiscard]] std::size_t size() const { return pages_.size(); }
  /// After the end: the last one.
  [[nodiscard]] cv::Mat at(std::size_t index) const;

 private:
  std::vector<std::vector<std::uint8_t>> pages_;
};

/// Two columns below a title, above what the symbols mean: kScreenWidth_px wide.
[[nodiscard]] cv::Mat pair_screen(const std::string& title, const std::string& note,
                                  const cv::Mat& left, const cv::Mat& right);

}  // namespace segsim::experiments::films::internal
