#include "reconstruction/labels/internal/nearest_surfels.h"

#include <algorithm>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "core/random.h"

namespace segsim::reconstruction::internal {
namespace {

std::vector<std::int64_t> by_comparing_all(const std::vector<glm::vec3>& position_m,
                                           std::int64_t surfel, std::size_t count) {
  std::vector<std::pair<float, std::int64_t>> all;
  for (std::size_t i = 0; i < position_m.size(); ++i) {
    const glm::vec3 d = position_m[i] - position_m[static_cast<std::size_t>(surfel)];
    if (static_cast<std::int64_t>(i) != surfel) all.emplace_back(glm::dot(d, d), i);
  }
  std::sort(all.begin(), all.end());
  std::vector<std::int64_t> nearest;
  for (std::size_t i = 0; i < std::min(count, all.size()); ++i) {
    nearest.push_back(all[i].second);
  }
  return nearest;
}

TEST(NearestSurfels, AreThoseThatComparingAllFinds) {
  core::RandomStream random(1, "surfels");
  std::vector<glm::vec3> position_m;
  for (int i = 0; i < 2000; ++i) {  // A floor and a wall of it, denser in one corner.
    const double x = 4.0 * random.uniform() * random.uniform(), y = random.uniform(-2.0, 2.0);
    position_m.emplace_back(x, i % 2 == 0 ? y : 2.0, i % 2 == 0 ? 0.0 : y + 2.0);
  }
  position_m.emplace_back(30.0F, -20.0F, 9.0F);  // Far from all.
  const NearestSurfels nearest(position_m);
  for (std::int64_t s = 0; s < 2001; s += 40) {
    for (const int count : {1, 5, 60}) {
      EXPECT_EQ(nearest.nearest(s, count),
                by_comparing_all(position_m, s, static_cast<std::size_t>(count)))
          << s << ", " << count;
    }
  }
}

TEST(NearestSurfels, OfFewThereAreFewer) {
  const std::vector<glm::vec3> one{{1.0F, 2.0F, 3.0F}};
  EXPECT_TRUE(NearestSurfels(one).nearest(0, 5).empty());
  const std::vector<glm::vec3> equal(4, glm::vec3(1.0F));
  EXPECT_EQ(NearestSurfels(equal).nearest(1, 5), (std::vector<std::int64_t>{0, 2, 3}));
}

}  // namespace
}  // namespace segsim::reconstruction::internal
