#include "perception/data/nms.h"

#include <algorithm>
#include <numeric>

namespace segsim::perception {

std::vector<core::Detection> suppress_overlaps(const std::vector<core::Detection>& detections,
                                               float max_iou, int max_count) {
  std::vector<std::size_t> order(detections.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return detections[a].score > detections[b].score;
  });
  std::vector<core::Detection> kept;
  for (const std::size_t i : order) {
    if (static_cast<int>(kept.size()) >= max_count) break;
    const core::Detection& candidate = detections[i];
    const bool hidden =
        std::any_of(kept.begin(), kept.end(), [&](const core::Detection& better) {
          return better.class_index == candidate.class_index &&
                 core::iou(better.box, candidate.box) > max_iou;
        });
    if (!hidden) kept.push_back(candidate);
  }
  return kept;
}

}  // namespace segsim::perception
