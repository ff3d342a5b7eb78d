#pragma once

/// @file
/// One moment of a trial as a picture: camera with detections, labels of the scene, the
/// robot's map, and a line of figures.
///
///     kWide                                  kColumn
///     +--------------------------------+     +---------------------+
///     | Find a chair ...   detector: x |     | detector: x         |
///     +----------+----------+----------+     +----------+----------+
///     |  camera  | panoptic |   map    |     |  camera  | panoptic |
///     +----------+----------+----------+     +----------+----------+
///     | EXPLORE  tick, time, distance  |     | EXPLORE  tick, ...  |
///     +--------------------------------+     +---------------------+
///                                            |         map         |
///                                            +---------------------+

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "core/render.h"
#include "core/stages.h"
#include "experiments/drawing/map_canvas.h"
#include "experiments/drawing/trial_picture.h"
#include "sim/trial/trial.h"

namespace segsim::experiments::video::internal {

enum class PageForm : std::uint8_t {
  kWide,
  kColumn,  ///< kColumnWidth_px x kColumnHeight_px.
};
inline constexpr int kColumnWidth_px = 634, kColumnHeight_px = 640;

/// Draws the pages of one trial; all have the same size.
class TrialPage {
 public:
  /// @param scene  Must outlive the object.
  TrialPage(const drawing::TrialScene& scene, std::vector<std::string> detector_classes,
            PageForm form);

  /// A tick without a page: its path is drawn later.
  void pass(const sim::TickRecord& tick) { track_.push_back(tick); }
  [[nodiscard]] cv::Mat draw(const sim::TickRecord& tick, const core::Frame& frame,
                             std::span<const core::Detection> detections,
                             const core::PolicyView& view);
  /// The last page with the outcome where the caption was. Not before the first.
  [[nodiscard]] cv::Mat draw_outcome(const sim::TrialResult& result) const;

 private:
  [[nodiscard]] cv::Mat camera_pane(const core::Frame& frame,
                                    std::span<const core::Detection> detections,
                                    const cv::Size& size) const;
  [[nodiscard]] cv::Mat map_pane(const core::PolicyView& view, const cv::Size& size);
  void draw_status(cv::Mat& page, const cv::Point& corner, int width_px,
                   const sim::TickRecord& tick,
                   std::span<const core::Detection> detections) const;

  const drawing::TrialScene& scene_;
  std::vector<std::string> classes_;
  PageForm form_;
  std::vector<sim::TickRecord> track_;
  std::optional<drawing::MapCanvas> empty_map_;  ///< The plan in the size of the pane.
  cv::Mat last_;
};

}  // namespace segsim::experiments::video::internal
