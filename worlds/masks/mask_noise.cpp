#include "worlds/masks/mask_noise.h"

#include <algorithm>

#include "core/check.h"

namespace segsim::worlds {

MaskNoise MaskNoise::at_level(double level) const {
  SEGSIM_CHECK(level >= 0.0, std::to_string(level));
  MaskNoise noise = scaled(level, level, level);
  noise.smallest_px *= std::min(level, 1.0);
  noise.merge *= level;
  noise.confuse *= level;
  return noise;
}

MaskNoise MaskNoise::scaled(double misses, double false_positives, double shapes) const {
  MaskNoise noise = *this;
  for (double* rate : {&noise.miss_always, &noise.miss_small, &noise.miss_border}) {
    *rate *= misses;
  }
  for (double* rate : {&noise.split, &noise.duplicate, &noise.hallucinate}) {
    *rate *= false_positives;
  }
  for (double* rate : {&noise.border_shift_px, &noise.border_wobble_px, &noise.leak}) {
    *rate *= shapes;
  }
  return noise;
}

std::vector<std::pair<std::string, double>> MaskNoise::listing() const {
  return {{"smallest_px", smallest_px},
          {"merge", merge},
          {"merge_reach_px", merge_reach_px},
          {"miss_always", miss_always},
          {"miss_small", miss_small},
          {"miss_area", miss_area},
          {"miss_border", miss_border},
          {"miss_correlation", miss_correlation},
          {"miss_step", miss_step},
          {"border_shift_px", border_shift_px},
          {"border_wobble_px", border_wobble_px},
          {"wobble_length_px", wobble_length_px},
          {"leak", leak},
          {"leak_share_min", leak_share_min},
          {"leak_share_max", leak_share_max},
          {"leak_outward", leak_outward},
          {"confuse", confuse},
          {"confuse_systematic", confuse_systematic},
          {"confuse_listed", confuse_listed},
          {"split", split},
          {"duplicate", duplicate},
          {"hallucinate", hallucinate},
          {"hallucinated_area", hallucinated_area},
          {"hallucinated_spread", hallucinated_spread},
          {"score_correlation", score_correlation}};
}

}  // namespace segsim::worlds
