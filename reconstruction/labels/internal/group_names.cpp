#include "reconstruction/labels/internal/group_names.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/check.h"

namespace segsim::reconstruction::internal {
namespace {

using Pair = std::pair<std::int64_t, std::int64_t>;

/// A mask of a thing or the region of a stuff class, in one view.
struct Region {
  std::int64_t pixels = 0, class_index = 0;
  std::vector<double> feature_sum;
};

/// What one view shows. Regions of stuff have keys below 0.
struct ViewCounts {
  std::map<std::int64_t, Region> regions;
  std::map<std::int64_t, std::int64_t> groups;  ///< Pixels, by group.
  std::map<Pair, std::int64_t> both;            ///< By group and region.
};

template <class Key>
Key most_of(const std::map<Key, std::int64_t>& counts) {
  return std::max_element(counts.begin(), counts.end(),
                          [](const auto& a, const auto& b) { return a.second < b.second; })
      ->first;
}

class Naming {
 public:
  Naming(const GroupedPixels& pixels, const std::vector<float>& group_feature,
         std::size_t groups, const std::vector<core::SceneClass>& classes,
         const GroupNamingOptions& options)
      : group_feature_(group_feature),
        size_(groups == 0 ? 0 : group_feature.size() / groups),
        classes_(classes),
        options_(options),
        pixel_classes_(groups),
        votes_(groups) {
    for (std::size_t i = 0; i < pixels.group.size(); ++i) count(pixels, i);
  }

  [[nodiscard]] std::vector<GroupName> names() {
    for (const auto& [frame, view] : views_) vote(view), compare(view);
    std::vector<GroupName> names(votes_.size());
    for (std::size_t g = 0; g < names.size(); ++g) {
      const auto& counts = votes_[g].empty() ? pixel_classes_[g] : votes_[g];
      if (!counts.empty()) names[g].class_index = most_of(counts);
    }
    number_objects(names);
    return names;
  }

 private:
  [[nodiscard]] bool thing(std::int64_t c) const {
    return c >= 0 && classes_[static_cast<std::size_t>(c)].thing;
  }

  void count(const GroupedPixels& pixels, std::size_t i) {
    const std::int64_t group = pixels.group[i], c = pixels.class_index[i];
    ++pixel_classes_[static_cast<std::size_t>(group)][c];
    ViewCounts& view = views_[pixels.frame[i]];
    ++view.groups[group];
    if (pixels.mask_id[i] == 0 && thing(c)) return;
    const std::int64_t key = pixels.mask_id[i] != 0 ? pixels.mask_id[i] : -1 - c;
    Region& region = view.regions[key];
    ++region.pixels;
    region.class_index = c;
    region.feature_sum.resize(size_, 0.0);
    for (std::size_t d = 0; d < size_; ++d) {
      region.feature_sum[d] += static_cast<double>(pixels.feature[i * size_ + d]);
    }
    ++view.both[{group, key}];
  }

  [[nodiscard]] double likeness(std::int64_t group, const Region& region) const {
    double difference = 0.0;
    for (std::size_t d = 0; d < size_; ++d) {
      const auto own =
          static_cast<double>(group_feature_[static_cast<std::size_t>(group) * size_ + d]);
      difference += std::abs(own - region.feature_sum[d] / static_cast<double>(region.pixels));
    }
    return 1.0 - difference / static_cast<double>(std::max<std::size_t>(size_, 1));
  }

  /// Every group that a mask fits gets a vote for its class.
  void vote(const ViewCounts& view) {
    std::map<std::int64_t, std::pair<double, std::int64_t>> best;  // Score, class.
    for (const auto& [pair, both] : view.both) {
      const Region& region = view.regions.at(pair.second);
      const std::int64_t all = view.groups.at(pair.first) + region.pixels - both;
      const double score =
          static_cast<double>(both) / static_cast<double>(all) * likeness(pair.first, region);
      auto& [best_score, best_class] = best[pair.first];
      if (score > best_score) best_score = score, best_class = region.class_index;
    }
    for (const auto& [group, found] : best) {
      if (found.first > options_.min_score) {
        ++votes_[static_cast<std::size_t>(group)][found.second];
      }
    }
  }

  /// Which groups lie in masks, and which in the same.
  void compare(const ViewCounts& view) {
    std::vector<Pair> lies_in;  // Group, mask.
    for (const auto& [pair, both] : view.both) {
      const std::int64_t pixels = view.groups.at(pair.first);
      if (pair.second > 0 && 2 * both > pixels) {
        lies_in.push_back(pair);
      }
    }
    for (std::size_t i = 0; i < lies_in.size(); ++i) {
      for (std::size_t j = i + 1; j < lies_in.size(); ++j) {
        const Pair groups{lies_in[i].first, lies_in[j].first};
        ++seen_[groups];
        if (lies_in[i].second == lies_in[j].second) ++together_[groups];
      }
    }
  }

  void number_objects(std::vector<GroupName>& names) const {
    std::vector<std::size_t> parent(names.size());
    std::iota(parent.begin(), parent.end(), std::size_t{0});
    const auto root = [&](std::size_t g) {
      while (parent[g] != g) g = parent[g];
      return g;
    };
    for (const auto& [groups, together] : together_) {
      const auto a = static_cast<std::size_t>(groups.first),
                 b = static_cast<std::size_t>(groups.second);
      const double share =
          static_cast<double>(together) / static_cast<double>(seen_.at(groups));
      if (names[a].class_index != names[b].class_index || share < options_.min_together) {
        continue;
      }
      const std::size_t ra = root(a), rb = root(b);
      parent[std::max(ra, rb)] = std::min(ra, rb);
    }
    std::int64_t objects = 0;
    for (std::size_t g = 0; g < names.size(); ++g) {
      if (!thing(names[g].class_index)) continue;
      const std::size_t r = root(g);
      names[g].object = r == g ? ++objects : names[r].object;
    }
  }

  const std::vector<float>& group_feature_;
  std::size_t size_;
  const std::vector<core::SceneClass>& classes_;
  GroupNamingOptions options_;
  std::vector<std::map<std::int64_t, std::int64_t>> pixel_classes_, votes_;  ///< [groups].
  std::map<std::int64_t, ViewCounts> views_;                                 ///< By frame.
  std::map<Pair, std::int64_t> seen_, together_;  ///< Views, by two groups.
};

}  // namespace

std::vector<GroupName> name_groups(const GroupedPixels& pixels,
                                   const std::vector<float>& group_feature, std::size_t groups,
                                   const std::vector<core::SceneClass>& classes,
                                   const GroupNamingOptions& options) {
  const std::size_t count = pixels.group.size();
  SEGSIM_CHECK(pixels.frame.size() == count && pixels.class_index.size() == count &&
                   pixels.mask_id.size() == count,
               "pixels");
  return Naming(pixels, group_feature, groups, classes, options).names();
}

}  // namespace segsim::reconstruction::internal
