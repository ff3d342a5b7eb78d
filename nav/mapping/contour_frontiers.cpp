#include "nav/mapping/contour_frontiers.h"

#include <algorithm>

#include <glm/geometric.hpp>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/check.h"

namespace segsim::nav {
namespace {

using Outline = std::vector<cv::Point>;

/// The map's part that holds explored cells, with a border in which everything outside is one
/// piece.
cv::Rect explored_part(const GridView<std::uint8_t>& explored, const CellBox& within,
                       int border) {
  const int width = explored.width_cells(), height = explored.height_cells();
  int left = width, right = -1, bottom = height, top = -1;
  for (int j = within.low.y; j <= within.high.y; ++j) {
    const std::uint8_t* row = explored.row(j);
    const std::uint8_t* end = row + within.high.x + 1;
    const std::uint8_t* first =
        std::find_if(row + within.low.x, end, [](auto v) { return v != 0; });
    if (first == end) continue;
    int last = within.high.x;
    while (row[last] == 0) --last;
    left = std::min(left, static_cast<int>(first - row));
    right = std::max(right, last);
    bottom = std::min(bottom, j);
    top = j;
  }
  if (right < 0) return {};
  left = std::max(left - border, 0);
  bottom = std::max(bottom - border, 0);
  return {left, bottom, std::min(right + border, width - 1) - left + 1,
          std::min(top + border, height - 1) - bottom + 1};
}

cv::Mat part_of(const GridView<std::uint8_t>& cells, const cv::Rect& part) {
  // OpenCV has no const header; nothing below writes through it.
  const cv::Mat all(cells.height_cells(), cells.width_cells(), CV_8U,
                    const_cast<std::uint8_t*>(cells.row(0)),
                    static_cast<std::size_t>(cells.stride()));
  return all(part);
}

/// Paints small pockets of navigable unexplored cells as explored.
void fill_pockets(cv::Mat& explored, const cv::Mat& navigable, double min_cells2) {
  const cv::Mat unexplored = navigable & (explored == 0);
  std::vector<Outline> outlines;
  cv::findContours(unexplored, outlines, cv::RETR_LIST, cv::CHAIN_APPROX_SIMPLE);
  for (std::size_t k = 0; k < outlines.size(); ++k) {
    if (cv::contourArea(outlines[k]) >= min_cells2) continue;
    // Outlines of holes enclose explored cells: only a pocket that is unexplored throughout
    // counts.
    const cv::Rect box = cv::boundingRect(outlines[k]);
    cv::Mat inside(box.size(), CV_8U, cv::Scalar(0));
    cv::drawContours(inside, outlines, static_cast<int>(k), cv::Scalar(1), cv::FILLED, 8,
                     cv::noArray(), 0, -box.tl());
    if (cv::countNonZero(inside & (unexplored(box) == 0)) > 0) continue;
    explored(box).setTo(1, inside);
  }
}

/// Contiguous runs of `on` along a closed outline; one that crosses its start is joined.
std::vector<std::vector<cv::Point>> runs_along(const Outline& outline,
                                               const std::vector<bool>& on) {
  std::vector<std::vector<cv::Point>> runs;
  for (std::size_t k = 0; k < outline.size(); ++k) {
    if (!on[k]) continue;
    if (k == 0 || !on[k - 1]) runs.emplace_back();
    runs.back().push_back(outline[k]);
  }
  if (runs.size() > 1 && on.front() && on.back()) {
    std::vector<cv::Point> joined = std::move(runs.back());
    runs.pop_back();
    joined.insert(joined.end(), runs.front().begin(), runs.front().end());
    runs.front() = std::move(joined);
  }
  return runs;
}

}  // namespace

glm::dvec2 middle_along(const std::vector<Cell>& cells) {
  SEGSIM_CHECK(!cells.empty(), "no cells");
  double length = 0.0;
  for (std::size_t k = 1; k < cells.size(); ++k) {
    length += glm::distance(glm::dvec2(cells[k - 1]), glm::dvec2(cells[k]));
  }
  double left = 0.5 * length;
  for (std::size_t k = 1; k < cells.size(); ++k) {
    const glm::dvec2 a(cells[k - 1]), b(cells[k]);
    const double step = glm::distance(a, b);
    if (step >= left && step > 0.0) return a + (b - a) * (left / step);
    left -= step;
  }
  return glm::dvec2(cells.back());
}

std::vector<ContourFrontier> find_contour_frontiers(const GridFrame& frame,
                                                    const GridView<std::uint8_t>& explored,
                                                    const GridView<std::uint8_t>& navigable,
                                                    const ContourFrontierOptions& options,
                                                    const std::optional<CellBox>& within) {
  SEGSIM_CHECK(same_size(explored, navigable), "explored and navigable differ in size");
  const double pocket_cells2 =
      options.min_pocket_m2 / (frame.resolution_m * frame.resolution_m);
  std::vector<ContourFrontier> frontiers;
  const cv::Rect part =
      explored_part(explored, within ? within->clipped_to(frame.box()) : frame.box(),
                    static_cast<int>(std::sqrt(pocket_cells2)) + 6);
  if (part.empty()) return frontiers;

  const cv::Mat free = part_of(navigable, part);
  cv::Mat seen;
  const int k = options.explored_dilation_cells;
  cv::dilate(part_of(explored, part), seen, cv::getStructuringElement(cv::MORPH_RECT, {k, k}));
  cv::bitwise_and(seen, free, seen);
  fill_pockets(seen, free, pocket_cells2);

  // Where the square around a cell holds an unexplored one.
  const cv::Mat unexplored = free & (seen == 0);
  cv::Mat beside;
  const int b = options.blur_cells;
  cv::dilate(unexplored, beside, cv::getStructuringElement(cv::MORPH_RECT, {b, b}));

  std::vector<Outline> outlines;
  cv::findContours(seen, outlines, cv::RETR_LIST, cv::CHAIN_APPROX_NONE);
  for (const Outline& outline : outlines) {
    std::vector<bool> on(outline.size());
    for (std::size_t n = 0; n < outline.size(); ++n) {
      on[n] = beside.at<std::uint8_t>(outline[n]) != 0;
    }
    for (const std::vector<cv::Point>& run : runs_along(outline, on)) {
      if (static_cast<int>(run.size()) < options.min_cells) continue;
      ContourFrontier frontier;
      frontier.cells.reserve(run.size());
      for (const cv::Point& p : run) frontier.cells.emplace_back(p.x + part.x, p.y + part.y);
      frontier.waypoint_m =
          frame.origin_m + (middle_along(frontier.cells) + 0.5) * frame.resolution_m;
      frontiers.push_back(std::move(frontier));
    }
  }
  return frontiers;
}

}  // namespace segsim::nav
