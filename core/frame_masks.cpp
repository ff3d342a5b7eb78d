#include "core/frame_masks.h"

#include <algorithm>
#include <map>
#include <utility>

#include "core/check.h"

namespace segsim::core {

std::vector<MaskSegment> segments_of(const FrameMasks& masks) {
  SEGSIM_CHECK(masks.semantic.size() == masks.instance.size() &&
                   masks.semantic.size() == masks.confidence.size(),
               "images of one view");
  struct Sum {
    MaskSegment segment;
    double confidence = 0.0;
  };
  std::map<std::pair<std::uint16_t, std::uint16_t>, Sum> sums;
  std::pair<std::uint16_t, std::uint16_t> last{0, 0};
  Sum* sum = nullptr;  // Of `last`: looked up once a run of equal pixels.
  for (int y = 0; y < masks.semantic.height_px(); ++y) {
    for (int x = 0; x < masks.semantic.width_px(); ++x) {
      const std::pair key{masks.instance(x, y), masks.semantic(x, y)};
      if (key.second == 0) continue;
      const auto left = static_cast<float>(x), top = static_cast<float>(y);
      if (sum == nullptr || key != last) {
        last = key;
        const auto [entry, is_new] = sums.try_emplace(key);
        sum = &entry->second;
        if (is_new) sum->segment = {key.first, key.second, 0.0F, 0, {left, top, left, top}};
      }
      MaskSegment& segment = sum->segment;
      ++segment.area_px;
      segment.box = {std::min(segment.box.x0, left), segment.box.y0,
                     std::max(segment.box.x1, left + 1.0F), top + 1.0F};
      sum->confidence += masks.confidence(x, y) / 255.0;
    }
  }
  std::vector<MaskSegment> segments;
  for (auto& [key, entry] : sums) {
    entry.segment.score = static_cast<float>(entry.confidence / entry.segment.area_px);
    segments.push_back(entry.segment);
  }
  return segments;
}

}  // namespace segsim::core
