#include "reconstruction/labels/guidance_graph.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <set>

#include <ATen/Parallel.h>
#include <glm/geometric.hpp>

#include "core/check.h"
#include "reconstruction/labels/internal/nearest_surfels.h"

namespace segsim::reconstruction {
namespace {

constexpr std::int64_t kSurfelsPerTask = 1024;
constexpr std::int32_t kAcross = -1;  ///< In place of the id of a mask.

/// Up to `count` neighbours of every surfel, not farther than gap_m.
std::vector<std::vector<std::int64_t>> neighbours(const std::vector<glm::vec3>& position_m,
                                                  int count, double gap_m) {
  const internal::NearestSurfels nearest(position_m);
  std::vector<std::vector<std::int64_t>> near(position_m.size());
  const auto all = static_cast<std::int64_t>(position_m.size());
  at::parallel_for(0, all, kSurfelsPerTask, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t s = begin; s < end; ++s) {
      const auto i = static_cast<std::size_t>(s);
      near[i] = nearest.nearest(s, count);
      std::erase_if(near[i], [&](std::int64_t other) {
        return static_cast<double>(glm::distance(position_m[static_cast<std::size_t>(other)],
                                                 position_m[i])) > gap_m;
      });
    }
  });
  return near;
}

template <class Key>
Key most_of(const std::map<Key, std::int64_t>& counts) {
  return std::max_element(counts.begin(), counts.end(),
                          [](const auto& a, const auto& b) { return a.second < b.second; })
      ->first;
}

}  // namespace

GuidanceGraph::GuidanceGraph(const std::vector<glm::vec3>& position_m,
                             const std::vector<glm::vec3>& normal,
                             const PanopticReconConfig& config)
    : config_(config), patch_of_(position_m.size(), -1) {
  SEGSIM_CHECK(normal.size() == position_m.size(), "normals");
  const auto near = neighbours(position_m, config.neighbours, config.max_gap_m);
  grow_patches(position_m, normal, near);
  find_edges(near);
}

/// From each surfel that is left, in order, to neighbours that face as the first one does.
void GuidanceGraph::grow_patches(const std::vector<glm::vec3>& position_m,
                                 const std::vector<glm::vec3>& normal,
                                 const std::vector<std::vector<std::int64_t>>& near) {
  constexpr std::int32_t kSmall = -2;  // Part of a patch that was given up.
  const auto least_cosine =
      static_cast<float>(std::cos(config_.max_angle_deg * std::numbers::pi / 180.0));
  const auto radius_m = static_cast<float>(config_.max_radius_m);
  std::vector<std::size_t> patch;
  for (std::size_t first = 0; first < patch_of_.size(); ++first) {
    if (patch_of_[first] != -1) continue;
    patch.assign(1, first);
    patch_of_[first] = patches_;
    for (std::size_t next = 0; next < patch.size(); ++next) {
      for (const std::int64_t other : near[patch[next]]) {
        const auto s = static_cast<std::size_t>(other);
        if (patch_of_[s] != -1 ||
            std::abs(glm::dot(normal[s], normal[first])) < least_cosine ||
            glm::distance(position_m[s], position_m[first]) > radius_m) {
          continue;
        }
        patch_of_[s] = patches_;
        patch.push_back(s);
      }
    }
    if (static_cast<int>(patch.size()) < config_.min_surfels) {
      for (const std::size_t s : patch) patch_of_[s] = kSmall;
    } else {
      ++patches_;
    }
  }
  std::replace(patch_of_.begin(), patch_of_.end(), kSmall, -1);
}

void GuidanceGraph::find_edges(const std::vector<std::vector<std::int64_t>>& near) {
  for (std::size_t s = 0; s < near.size(); ++s) {
    for (const std::int64_t other : near[s]) {
      const std::int32_t a = patch_of_[s], b = patch_of_[static_cast<std::size_t>(other)];
      if (a >= 0 && b >= 0 && a != b) edges_[std::minmax(a, b)] = 0;
    }
  }
}

void GuidanceGraph::add_view(const core::FrameMasks& masks,
                             std::span<const std::int32_t> pixels,
                             std::span<const std::int64_t> surfel) {
  SEGSIM_CHECK(pixels.size() == surfel.size(), "pixels");
  // By patch: pixels of each mask; 0 = of a stuff class. Void pixels say nothing.
  std::map<std::int32_t, std::map<std::uint16_t, std::int64_t>> shows;
  std::map<std::uint16_t, Mask>& view = views_.emplace_back();
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const std::uint16_t class_id = masks.semantic.data()[pixels[i]];
    const std::uint16_t id = masks.instance.data()[pixels[i]];
    if (class_id == 0 || surfel[i] < 0) continue;
    const std::int32_t patch = patch_of_[static_cast<std::size_t>(surfel[i])];
    if (patch >= 0) ++shows[patch][id];
    if (id == 0) continue;
    Mask& mask = view[id];
    ++mask.patches[patch];
    ++mask.classes[class_id];
    ++mask.pixels;
  }
  // A patch across the border of masks is in none, and votes against its edges.
  std::map<std::int32_t, std::int32_t> lies_in;
  for (const auto& [patch, by_mask] : shows) {
    std::int64_t all = 0;
    for (const auto& [id, count] : by_mask) all += count;
    const std::uint16_t id = most_of(by_mask);
    const bool inside =
        static_cast<double>(by_mask.at(id)) > config_.min_inside * static_cast<double>(all);
    lies_in[patch] = inside ? std::int32_t{id} : kAcross;
  }
  for (auto& [patches, votes] : edges_) {
    const auto a = lies_in.find(patches.first), b = lies_in.find(patches.second);
    if (a == lies_in.end() || b == lies_in.end()) continue;
    if (a->second != b->second || a->second == kAcross) --votes;
    if (a->second == b->second && a->second > 0) ++votes;
  }
}

std::vector<std::int32_t> GuidanceGraph::joined_patches() const {
  std::vector<std::int32_t> parent(static_cast<std::size_t>(patches_));
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&](std::int32_t p) {
    while (parent[static_cast<std::size_t>(p)] != p) p = parent[static_cast<std::size_t>(p)];
    return p;
  };
  for (const auto& [patches, votes] : edges_) {
    if (votes <= 0) continue;
    const std::int32_t a = root(patches.first), b = root(patches.second);
    parent[static_cast<std::size_t>(std::max(a, b))] = std::min(a, b);
  }
  std::vector<std::int32_t> joined;
  for (std::int32_t p = 0; p < patches_; ++p) joined.push_back(root(p));
  return joined;
}

GuidedObjects GuidanceGraph::objects() const {
  const std::vector<std::int32_t> joined = joined_patches();
  // Which group of patches each mask shows, and what the masks of a group say.
  struct Group {
    std::set<std::size_t> views;
    std::map<std::uint16_t, std::int64_t> classes;
    std::int64_t pixels = 0;
    std::vector<std::pair<std::size_t, std::uint16_t>> masks;
  };
  std::map<std::int32_t, Group> groups;
  for (std::size_t view = 0; view < views_.size(); ++view) {
    for (const auto& [id, mask] : views_[view]) {
      std::map<std::int32_t, std::int64_t> on;  // Pixels by group.
      for (const auto& [patch, count] : mask.patches) {
        if (patch >= 0) on[joined[static_cast<std::size_t>(patch)]] += count;
      }
      if (on.empty()) continue;
      const std::int32_t best = most_of(on);
      if (static_cast<double>(on[best]) <
          config_.min_inside * static_cast<double>(mask.pixels)) {
        continue;
      }
      Group& group = groups[best];
      group.views.insert(view);
      group.masks.emplace_back(view, id);
      group.pixels += mask.pixels;
      for (const auto& [class_id, count] : mask.classes) group.classes[class_id] += count;
    }
  }
  std::vector<const Group*> kept;
  for (const auto& [patch, group] : groups) {
    if (static_cast<int>(group.views.size()) >= config_.min_views) kept.push_back(&group);
  }
  std::stable_sort(kept.begin(), kept.end(),
                   [](const Group* a, const Group* b) { return a->pixels > b->pixels; });
  kept.resize(std::min<std::size_t>(kept.size(), 65534));
  GuidedObjects objects;
  objects.object_of_mask.resize(views_.size());
  for (const Group* group : kept) {
    objects.class_id.push_back(most_of(group->classes));
    for (const auto& [view, id] : group->masks) {
      objects.object_of_mask[view][id] = static_cast<std::uint16_t>(objects.class_id.size());
    }
  }
  return objects;
}

}  // namespace segsim::reconstruction
