#include "reconstruction/labels/mask_association.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <queue>
#include <set>
#include <utility>

#include "core/check.h"

namespace segsim::reconstruction {
namespace {

/// Sparse vector of counts, ascending by index.
using Counts = std::vector<std::pair<std::int32_t, std::int32_t>>;

double dot(const Counts& a, const Counts& b) {
  double sum = 0.0;
  for (auto i = a.begin(), j = b.begin(); i != a.end() && j != b.end();) {
    if (i->first == j->first) {
      sum += static_cast<double>(i->second) * static_cast<double>(j->second);
      ++i, ++j;
    } else if (i->first < j->first) {
      ++i;
    } else {
      ++j;
    }
  }
  return sum;
}

Counts operator+(const Counts& a, const Counts& b) {
  Counts sum;
  sum.reserve(a.size() + b.size());
  for (auto i = a.begin(), j = b.begin(); i != a.end() || j != b.end();) {
    if (j == b.end() || (i != a.end() && i->first < j->first)) {
      sum.push_back(*i++);
    } else if (i == a.end() || j->first < i->first) {
      sum.push_back(*j++);
    } else {
      sum.emplace_back(i->first, i->second + j->second);
      ++i, ++j;
    }
  }
  return sum;
}

/// Counts that are cleared in the time of what was counted.
class Tally {
 public:
  explicit Tally(std::size_t size) : count_(size, 0) {}
  void add(std::int32_t i) {
    if (count_[static_cast<std::size_t>(i)]++ == 0) touched_.push_back(i);
  }
  [[nodiscard]] double operator[](std::int32_t i) const {
    return count_[static_cast<std::size_t>(i)];
  }
  [[nodiscard]] const std::vector<std::int32_t>& touched() const { return touched_; }
  void clear() {
    for (const std::int32_t i : touched_) count_[static_cast<std::size_t>(i)] = 0;
    touched_.clear();
  }

 private:
  std::vector<std::int32_t> count_, touched_;
};

/// Masks that belong together so far.
struct Cluster {
  std::vector<std::int32_t> masks;
  Counts seen_in;                        ///< View -> masks of this cluster that it sees.
  Counts inside;                         ///< Mask -> masks of this cluster that lie in it.
  std::vector<std::int32_t> neighbours;  ///< Ascending; some may have been joined since.
  std::int32_t version = 0;
  bool alive = true;
};

/// Share of the views seeing both that explain both by one mask, averaged over all pairs of
/// masks. One more view that does not agree keeps pairs with few witnesses behind others.
double consensus(const Cluster& a, const Cluster& b) {
  const double pairs =
      static_cast<double>(a.masks.size()) * static_cast<double>(b.masks.size());
  return dot(a.inside, b.inside) / (dot(a.seen_in, b.seen_in) + pairs);
}

void keep_unique(std::vector<std::int32_t>& values, std::int32_t but) {
  std::sort(values.begin(), values.end());
  values.erase(std::unique(values.begin(), values.end()), values.end());
  std::erase(values, but);
}

struct Candidate {
  double consensus;
  std::int32_t a, b, version_a, version_b;
  bool operator<(const Candidate& other) const {
    return std::tie(consensus, other.a, other.b) < std::tie(other.consensus, a, b);
  }
};

}  // namespace

/// The steps of objects().
class AssociationRun {
 public:
  explicit AssociationRun(const MaskAssociation& in)
      : in_(in),
        config_(in.config_),
        seen_(static_cast<std::size_t>(in.views_)),
        in_mask_(in.masks_.size()) {
    for (std::size_t m = 0; m < in_.masks_.size(); ++m) clusters_.push_back(alone(m));
    for (std::size_t c = 0; c < clusters_.size(); ++c) {
      joined_into_.push_back(static_cast<std::int32_t>(c));
    }
    find_neighbours();
    join();
    vote();
  }

  [[nodiscard]] std::vector<AssociatedObject> objects() const;

 private:
  using Mask = MaskAssociation::Mask;
  using Sighting = MaskAssociation::Sighting;

  /// Which views see a mask's surface, and the masks it lies in there.
  [[nodiscard]] Cluster alone(std::size_t mask);
  void find_neighbours();
  void join();
  void merge(std::int32_t into, std::int32_t from);
  /// The cluster that a cluster is part of now.
  [[nodiscard]] std::int32_t joined(std::int32_t cluster) {
    while (joined_into_[static_cast<std::size_t>(cluster)] != cluster) {
      cluster = joined_into_[static_cast<std::size_t>(cluster)];
    }
    return cluster;
  }
  void vote();
  /// [clusters]: the masks that it won most voxels of.
  [[nodiscard]] std::vector<std::vector<std::int32_t>> masks_by_object() const;

  const MaskAssociation& in_;
  const AssociationConfig& config_;
  Tally seen_, in_mask_;  ///< Voxels by view and by mask.
  std::vector<Cluster> clusters_;
  std::vector<std::int32_t> joined_into_;  ///< Itself while it is alive.
  std::priority_queue<Candidate> queue_;
  std::vector<std::vector<std::int32_t>> won_;  ///< [clusters] -> voxels.
};

Cluster AssociationRun::alone(std::size_t mask) {
  const std::vector<std::int32_t>& voxels = in_.masks_[mask].voxels;
  for (const std::int32_t v : voxels) {
    for (const Sighting& s : in_.voxels_[static_cast<std::size_t>(v)].sightings) {
      seen_.add(s.view);
      if (s.mask >= 0) in_mask_.add(s.mask);
    }
  }
  Cluster cluster;
  cluster.masks = {static_cast<std::int32_t>(mask)};
  const double enough = config_.min_visible * static_cast<double>(voxels.size());
  for (const std::int32_t view : seen_.touched()) {
    if (seen_[view] >= enough) cluster.seen_in.emplace_back(view, 1);
  }
  for (const std::int32_t other : in_mask_.touched()) {
    const double all = seen_[in_.masks_[static_cast<std::size_t>(other)].view];
    if (all >= enough && in_mask_[other] > config_.min_inside * all) {
      cluster.inside.emplace_back(other, 1);
    }
  }
  std::sort(cluster.seen_in.begin(), cluster.seen_in.end());
  std::sort(cluster.inside.begin(), cluster.inside.end());
  seen_.clear();
  in_mask_.clear();
  return cluster;
}

void AssociationRun::find_neighbours() {
  std::vector<std::vector<std::int32_t>> holds(in_.masks_.size());
  for (std::size_t c = 0; c < clusters_.size(); ++c) {
    for (const auto& [mask, count] : clusters_[c].inside) {
      holds[static_cast<std::size_t>(mask)].push_back(static_cast<std::int32_t>(c));
    }
  }
  for (std::size_t c = 0; c < clusters_.size(); ++c) {
    std::vector<std::int32_t>& of_c = clusters_[c].neighbours;
    for (const auto& [mask, count] : clusters_[c].inside) {
      const std::vector<std::int32_t>& together = holds[static_cast<std::size_t>(mask)];
      of_c.insert(of_c.end(), together.begin(), together.end());
      keep_unique(of_c, static_cast<std::int32_t>(c));
    }
  }
}

void AssociationRun::join() {
  const auto offer = [&](std::int32_t a, std::int32_t b) {
    const Cluster &one = clusters_[static_cast<std::size_t>(a)],
                  &two = clusters_[static_cast<std::size_t>(b)];
    const double value = consensus(one, two);
    if (value >= config_.min_consensus) queue_.push({value, a, b, one.version, two.version});
  };
  for (std::size_t a = 0; a < clusters_.size(); ++a) {
    for (const std::int32_t b : clusters_[a].neighbours) {
      if (static_cast<std::int32_t>(a) < b) offer(static_cast<std::int32_t>(a), b);
    }
  }
  while (!queue_.empty()) {
    const Candidate best = queue_.top();
    queue_.pop();
    const Cluster &a = clusters_[static_cast<std::size_t>(best.a)],
                  &b = clusters_[static_cast<std::size_t>(best.b)];
    if (!a.alive || !b.alive || a.version != best.version_a || b.version != best.version_b) {
      continue;
    }
    merge(best.a, best.b);
    for (const std::int32_t c : clusters_[static_cast<std::size_t>(best.a)].neighbours) {
      offer(std::min(best.a, c), std::max(best.a, c));
    }
  }
}

void AssociationRun::merge(std::int32_t into, std::int32_t from) {
  Cluster &a = clusters_[static_cast<std::size_t>(into)],
          &b = clusters_[static_cast<std::size_t>(from)];
  a.masks.insert(a.masks.end(), b.masks.begin(), b.masks.end());
  a.seen_in = a.seen_in + b.seen_in;
  a.inside = a.inside + b.inside;
  joined_into_[static_cast<std::size_t>(from)] = into;
  a.neighbours.insert(a.neighbours.end(), b.neighbours.begin(), b.neighbours.end());
  for (std::int32_t& c : a.neighbours) c = joined(c);
  keep_unique(a.neighbours, into);
  ++a.version;
  b = Cluster{};
  b.alive = false;
}

/// Every voxel goes to the cluster that most views show there, unless more show none.
void AssociationRun::vote() {
  std::vector<std::int32_t> cluster_of(in_.masks_.size(), -1);
  for (std::size_t c = 0; c < clusters_.size(); ++c) {
    for (const std::int32_t m : clusters_[c].masks) {
      cluster_of[static_cast<std::size_t>(m)] = static_cast<std::int32_t>(c);
    }
  }
  won_.resize(clusters_.size());
  std::map<std::int32_t, std::int32_t> votes;
  for (std::size_t v = 0; v < in_.voxels_.size(); ++v) {
    votes.clear();
    for (const Sighting& s : in_.voxels_[v].sightings) {
      ++votes[s.mask < 0 ? -1 : cluster_of[static_cast<std::size_t>(s.mask)]];
    }
    const auto best =
        std::max_element(votes.begin(), votes.end(),
                         [](const auto& a, const auto& b) { return a.second < b.second; });
    if (best != votes.end() && best->first >= 0) {
      won_[static_cast<std::size_t>(best->first)].push_back(static_cast<std::int32_t>(v));
    }
  }
}

std::vector<std::vector<std::int32_t>> AssociationRun::masks_by_object() const {
  std::vector<std::int32_t> winner(in_.voxels_.size(), -1);
  for (std::size_t c = 0; c < won_.size(); ++c) {
    for (const std::int32_t v : won_[c]) {
      winner[static_cast<std::size_t>(v)] = static_cast<std::int32_t>(c);
    }
  }
  std::vector<std::vector<std::int32_t>> lies_on(clusters_.size());
  std::map<std::int32_t, std::size_t> voxels_of;
  for (std::size_t m = 0; m < in_.masks_.size(); ++m) {
    voxels_of.clear();
    const std::vector<std::int32_t>& voxels = in_.masks_[m].voxels;
    for (const std::int32_t v : voxels) ++voxels_of[winner[static_cast<std::size_t>(v)]];
    voxels_of.erase(-1);
    const auto best =
        std::max_element(voxels_of.begin(), voxels_of.end(),
                         [](const auto& a, const auto& b) { return a.second < b.second; });
    if (best == voxels_of.end() ||
        static_cast<double>(best->second) <
            config_.min_inside * static_cast<double>(voxels.size())) {
      continue;
    }
    lies_on[static_cast<std::size_t>(best->first)].push_back(static_cast<std::int32_t>(m));
  }
  return lies_on;
}

std::vector<AssociatedObject> AssociationRun::objects() const {
  const std::vector<std::vector<std::int32_t>> lies_on = masks_by_object();
  std::vector<AssociatedObject> objects;
  for (std::size_t c = 0; c < clusters_.size(); ++c) {
    std::set<std::int32_t> views;
    std::set<std::int32_t> claimed;
    std::map<std::uint16_t, std::size_t> classes;
    for (const std::int32_t m : clusters_[c].masks) {
      const Mask& mask = in_.masks_[static_cast<std::size_t>(m)];
      views.insert(mask.view);
      classes[mask.class_id] += mask.voxels.size();
      claimed.insert(mask.voxels.begin(), mask.voxels.end());
    }
    const std::vector<std::int32_t>& won = won_[c];
    if (static_cast<int>(views.size()) < config_.min_views ||
        static_cast<int>(won.size()) < config_.min_voxels ||
        static_cast<double>(won.size()) <
            config_.min_won * static_cast<double>(claimed.size())) {
      continue;
    }
    glm::dvec3 sum(0.0), squares(0.0);
    for (const std::int32_t v : won) {
      const glm::dvec3 p(in_.voxels_[static_cast<std::size_t>(v)].position_m);
      sum += p;
      squares += p * p;
    }
    const auto n = static_cast<double>(won.size());
    const glm::dvec3 mean = sum / n;
    AssociatedObject object;
    object.mean_m = mean;
    object.sigma_m = glm::sqrt(glm::max(squares / n - mean * mean, glm::dvec3(0.0)));
    object.class_id =
        std::max_element(classes.begin(), classes.end(), [](const auto& a, const auto& b) {
          return a.second < b.second;
        })->first;
    object.views = static_cast<std::int64_t>(views.size());
    object.voxels = static_cast<std::int64_t>(won.size());
    for (const std::int32_t m : lies_on[c]) {
      const Mask& mask = in_.masks_[static_cast<std::size_t>(m)];
      object.masks.push_back({mask.view, mask.id});
    }
    objects.push_back(object);
  }
  std::stable_sort(objects.begin(), objects.end(),
                   [](const auto& a, const auto& b) { return a.voxels > b.voxels; });
  return objects;
}

MaskAssociation::MaskAssociation(const AssociationConfig& config) : config_(config) {
  SEGSIM_CHECK(config.voxel_m > 0.0, "voxel_m");
}

std::int32_t MaskAssociation::voxel_at(const glm::dvec3& p_m) {
  constexpr std::int64_t kBias = 1 << 20;  // 21 bits an axis.
  const glm::dvec3 cell = glm::floor(p_m / config_.voxel_m);
  std::uint64_t key = 0;
  for (int axis = 0; axis < 3; ++axis) {
    key =
        key << 21 |
        (static_cast<std::uint64_t>(static_cast<std::int64_t>(cell[axis]) + kBias) & 0x1fffff);
  }
  const auto [at, is_new] = index_.try_emplace(key, static_cast<std::int32_t>(voxels_.size()));
  if (is_new) voxels_.push_back({glm::vec3(p_m), {}});
  return at->second;
}

void MaskAssociation::add_view(const core::FrameMasks& masks,
                               const core::Image<float>& depth_m,
                               const core::CameraIntrinsics& camera,
                               const core::CameraPose& T_world_camera) {
  SEGSIM_CHECK(depth_m.width_px() == masks.instance.width_px() &&
                   depth_m.height_px() == masks.instance.height_px(),
               "depth and masks of one size");
  const std::int32_t view = views_++;
  const int step = std::max(1, static_cast<int>(std::lround(std::sqrt(
                                   static_cast<double>(depth_m.size()) / config_.pixels))));
  std::map<std::uint16_t, std::pair<std::int32_t, std::map<std::uint16_t, int>>> of_id;
  std::vector<std::pair<std::int32_t, std::int32_t>> samples;  // voxel, mask
  for (int y = step / 2; y < depth_m.height_px(); y += step) {
    for (int x = step / 2; x < depth_m.width_px(); x += step) {
      const auto depth = static_cast<double>(depth_m(x, y));
      const std::uint16_t id = masks.instance(x, y), class_id = masks.semantic(x, y);
      if (!(depth > config_.min_depth_m) || class_id == 0) continue;
      const glm::dvec3 p_m =
          T_world_camera.rotation() * camera.back_project({x + 0.5, y + 0.5}, depth) +
          T_world_camera.translation_m();
      std::int32_t mask = -1;
      if (id != 0) {
        auto [at, is_new] = of_id.try_emplace(id);
        if (is_new) {
          at->second.first = static_cast<std::int32_t>(masks_.size());
          masks_.push_back({view, id, 0, {}});
        }
        ++at->second.second[class_id];
        mask = at->second.first;
      }
      samples.emplace_back(voxel_at(p_m), mask);
    }
  }
  for (const auto& [id, mask] : of_id) {
    masks_[static_cast<std::size_t>(mask.first)].class_id =
        std::max_element(mask.second.begin(), mask.second.end(),
                         [](const auto& a, const auto& b) { return a.second < b.second; })
            ->first;
  }
  std::sort(samples.begin(), samples.end());
  for (std::size_t i = 0; i < samples.size();) {
    std::size_t end = i, best = i, most = 0;
    while (end < samples.size() && samples[end].first == samples[i].first) {
      std::size_t run = end;
      while (run < samples.size() && samples[run] == samples[end]) ++run;
      if (run - end > most) most = run - end, best = end;
      end = run;
    }
    const auto [voxel, mask] = samples[best];
    voxels_[static_cast<std::size_t>(voxel)].sightings.push_back({view, mask});
    if (mask >= 0) masks_[static_cast<std::size_t>(mask)].voxels.push_back(voxel);
    i = end;
  }
}

std::vector<AssociatedObject> MaskAssociation::objects() const {
  return AssociationRun(*this).objects();
}

}  // namespace segsim::reconstruction
