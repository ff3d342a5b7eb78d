#include "experiments/drawing/goal_boxes.h"

#include <algorithm>
#include <map>

namespace segsim::experiments::drawing {
namespace {

constexpr double kSmallestDrawn_px = 10.0;  // Less is a crumb at the edge of another object.

}  // namespace

std::vector<perception::LabeledBox> goal_boxes(const core::Frame& frame,
                                               const sim::GoalObjects& goal) {
  std::map<std::uint16_t, perception::LabeledBox> boxes;
  for (int j = 0; j < frame.semantic.height_px(); ++j) {
    for (int i = 0; i < frame.semantic.width_px(); ++i) {
      if (!goal.holds(frame.semantic(i, j), frame.instance(i, j))) continue;
      const auto x = static_cast<float>(i), y = static_cast<float>(j);
      const auto [at, fresh] = boxes.try_emplace(frame.instance(i, j));
      core::BoxPx& box = at->second.box;
      if (fresh) box = {x, y, x + 1, y + 1};
      box = {std::min(box.x0, x), std::min(box.y0, y), std::max(box.x1, x + 1),
             std::max(box.y1, y + 1)};
      at->second.area_px2 += 1.0;
    }
  }
  std::vector<perception::LabeledBox> list;
  for (const auto& [id, box] : boxes) {
    if (box.area_px2 >= kSmallestDrawn_px) list.push_back(box);
  }
  return list;
}

}  // namespace segsim::experiments::drawing
