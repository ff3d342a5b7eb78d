#pragma once

/// @file
/// The trials of a run by episode and arm, for all groups of its table.

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "experiments/records/store.h"

namespace segsim::experiments::results::internal {

/// What one arm made of one episode; `usable` is 0 if no usable trial exists.
struct EpisodeResult {
  int usable = 0;
  bool success = false;
  double spl = 0.0, soft_spl = 0.0, sim_s = 0.0, path_m = 0.0;
};

/// Trials of one arm in one episode.
struct EpisodeArm {
  std::span<const records::TrialRow* const> trials;
  EpisodeResult result;
};

/// One episode of a group.
struct Episode {
  std::size_t scene;                 ///< Index of the scene's family; the last: of no scene.
  const records::TrialRow* first;    ///< One of its trials.
  std::span<const EpisodeArm> arms;  ///< By row of the run's arms.
};

/// Scenes of the spec, in the order of the run.
[[nodiscard]] std::vector<const records::SceneRow*> scene_families(
    const std::vector<records::SceneRow>& scenes);

/// The trials of a run, sorted once for all groups: by episode, so that sums have a fixed
/// order, then by arm. Reconstructions of a scene share its episodes.
class SortedTrials {
 public:
  using Belongs = std::function<bool(const Episode&)>;

  SortedTrials(const std::vector<records::TrialRow>& trials,
               const std::vector<records::SceneRow>& scenes,
               const std::vector<records::ArmRow>& arms);

  /// Those that belong to a group.
  [[nodiscard]] std::vector<Episode> episodes(const Belongs& belongs) const;

 private:
  struct Entry {
    std::size_t arm;
    std::size_t scene;  ///< Its family.
    const records::TrialRow* trial;
  };
  static bool of_one_episode(const Entry& a, const Entry& b);
  void fill_cells(const std::vector<Entry>& entries);

  std::size_t arms_;
  std::vector<const records::TrialRow*> sorted_;
  std::vector<EpisodeArm> cells_;  ///< Episodes x arms.
  std::vector<Entry> firsts_;      ///< Of each episode.
};

}  // namespace segsim::experiments::results::internal
