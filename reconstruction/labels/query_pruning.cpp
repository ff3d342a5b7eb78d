#include "reconstruction/labels/query_pruning.h"

#include <algorithm>
#include <iterator>
#include <numeric>

namespace segsim::reconstruction {
namespace {

std::size_t common(const std::vector<std::int64_t>& a, const std::vector<std::int64_t>& b) {
  std::size_t count = 0;
  for (auto i = a.begin(), j = b.begin(); i != a.end() && j != b.end();) {
    if (*i == *j)
      ++count, ++i, ++j;
    else if (*i < *j)
      ++i;
    else
      ++j;
  }
  return count;
}

bool overlaps(const QueryUse& a, const QueryUse& b, double max_overlap) {
  const std::size_t smaller = std::min(a.surfels.size(), b.surfels.size());
  return smaller > 0 && static_cast<double>(common(a.surfels, b.surfels)) >
                            max_overlap * static_cast<double>(smaller);
}

}  // namespace

std::vector<std::int64_t> queries_to_keep(std::span<const QueryUse> queries,
                                          const QueryConfig& config) {
  std::vector<std::int64_t> order(queries.size()), kept;
  std::iota(order.begin(), order.end(), std::int64_t{0});
  const auto use = [&](std::int64_t q) -> const QueryUse& {
    return queries[static_cast<std::size_t>(q)];
  };
  std::stable_sort(order.begin(), order.end(), [&](std::int64_t a, std::int64_t b) {
    return use(a).matches > use(b).matches;
  });
  for (const std::int64_t q : order) {
    if (use(q).recent_matches == 0 || use(q).frames < config.min_frames) continue;
    const bool repeats = std::any_of(kept.begin(), kept.end(), [&](std::int64_t other) {
      return overlaps(use(q), use(other), config.max_overlap);
    });
    if (!repeats) kept.push_back(q);
  }
  if (kept.empty()) kept = order;
  std::sort(kept.begin(), kept.end());
  return kept;
}

}  // namespace segsim::reconstruction
