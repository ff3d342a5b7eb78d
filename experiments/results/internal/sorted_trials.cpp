#include "experiments/results/internal/sorted_trials.h"

#include <algorithm>
#include <map>
#include <string>
#include <tuple>

namespace segsim::experiments::results::internal {
namespace {

EpisodeResult result_of(std::span<const records::TrialRow* const> trials) {
  EpisodeResult result;
  int successes = 0;
  for (const records::TrialRow* trial : trials) {
    if (!trial->counts()) continue;
    ++result.usable;
    successes += trial->success ? 1 : 0;
    result.spl += trial->spl;
    result.soft_spl += trial->soft_spl;
    result.sim_s += trial->sim_s;
    result.path_m += trial->path_m;
  }
  if (result.usable == 0) return result;
  result.success = 2 * successes > result.usable;
  result.spl /= result.usable;
  result.soft_spl /= result.usable;
  result.sim_s /= result.usable;
  result.path_m /= result.usable;
  return result;
}

}  // namespace

std::vector<const records::SceneRow*> scene_families(
    const std::vector<records::SceneRow>& scenes) {
  std::vector<const records::SceneRow*> families;
  for (const records::SceneRow& scene : scenes) {
    const auto same = [&](const records::SceneRow* known) {
      return records::family_of(*known) == records::family_of(scene);
    };
    if (std::none_of(families.begin(), families.end(), same)) families.push_back(&scene);
  }
  return families;
}

SortedTrials::SortedTrials(const std::vector<records::TrialRow>& trials,
                           const std::vector<records::SceneRow>& scenes,
                           const std::vector<records::ArmRow>& arms)
    : arms_(arms.size()) {
  const std::vector<const records::SceneRow*> families = scene_families(scenes);
  std::map<std::string, std::size_t> family;
  for (const records::SceneRow& scene : scenes) {
    std::size_t k = 0;
    while (records::family_of(*families[k]) != records::family_of(scene)) ++k;
    family[scene.name] = k;
  }
  std::vector<Entry> entries;
  entries.reserve(trials.size());
  for (const records::TrialRow& trial : trials) {
    std::size_t arm = 0;
    while (arm < arms_ && arms[arm].name != trial.arm) ++arm;
    if (arm == arms_) continue;  // In no group.
    const auto found = family.find(trial.scene);
    entries.push_back({arm, found == family.end() ? families.size() : found->second, &trial});
  }
  std::stable_sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    const auto key = [](const Entry& e) {
      return std::tie(e.trial->episode, e.scene, e.trial->goal_class, e.arm);
    };
    return key(a) < key(b);
  });
  sorted_.reserve(entries.size());
  for (const Entry& entry : entries) sorted_.push_back(entry.trial);
  fill_cells(entries);
}

std::vector<Episode> SortedTrials::episodes(const Belongs& belongs) const {
  std::vector<Episode> chosen;
  for (std::size_t k = 0; k < firsts_.size(); ++k) {
    const Episode episode{firsts_[k].scene, firsts_[k].trial,
                          std::span(cells_).subspan(k * arms_, arms_)};
    if (belongs(episode)) chosen.push_back(episode);
  }
  return chosen;
}

bool SortedTrials::of_one_episode(const Entry& a, const Entry& b) {
  return a.trial->episode == b.trial->episode && a.scene == b.scene &&
         a.trial->goal_class == b.trial->goal_class;
}

void SortedTrials::fill_cells(const std::vector<Entry>& entries) {
  for (std::size_t begin = 0; begin < entries.size();) {
    const std::size_t first = cells_.size();
    cells_.resize(first + arms_);
    std::size_t end = begin;
    while (end < entries.size() && of_one_episode(entries[begin], entries[end])) {
      const std::size_t from = end;
      while (end < entries.size() && entries[end].arm == entries[from].arm &&
             of_one_episode(entries[begin], entries[end])) {
        ++end;
      }
      EpisodeArm& cell = cells_[first + entries[from].arm];
      cell.trials = std::span(sorted_).subspan(from, end - from);
      cell.result = result_of(cell.trials);
    }
    firsts_.push_back(entries[begin]);
    begin = end;
  }
}

}  // namespace segsim::experiments::results::internal
