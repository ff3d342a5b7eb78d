#include "experiments/films/demo_video.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

#include "core/error.h"
#include "core/formatted.h"
#include "core/progress.h"
#include "experiments/films/internal/pages.h"
#include "experiments/films/internal/pair_film.h"
#include "experiments/films/internal/title_card.h"
#include "experiments/video/video_file.h"
#include "sim/trial/goal_objects.h"

namespace segsim::experiments::films {
namespace {

constexpr double kFrames_per_s = 12.0;
// How long things are shown [s]; with three pairs 60 to 90 in all.
constexpr double kTitle_s = 6.0, kReading_s = 8.0, kPairTitle_s = 3.5, kOutcome_s = 2.0;
constexpr double kResult_s = 12.0;
constexpr double kPair_s =
    13.0;  ///< At most, but for trials that the least speed makes longer.

using Pair = std::pair<const records::TrialRow*, const records::TrialRow*>;

double longer_s(const Pair& pair) { return std::max(pair.first->sim_s, pair.second->sim_s); }

/// The one whose longer trial is of median length; ties by name.
const Pair& median_pair(std::vector<Pair>& pairs) {
  std::sort(pairs.begin(), pairs.end(), [](const Pair& a, const Pair& b) {
    return std::tuple(longer_s(a), a.first->episode) <
           std::tuple(longer_s(b), b.first->episode);
  });
  return pairs[pairs.size() / 2];
}

std::string one_of(std::size_t count, const std::string& what) {
  return count == 1 ? "The only episode " + what + "."
                    : "One of " + std::to_string(count) + " episodes " + what +
                          ": the one of median length.";
}

/// Pairs by what came out: 2 * before succeeded + after succeeded.
std::map<int, std::vector<Pair>> pairs_by_outcome(const std::vector<records::TrialRow>& trials,
                                                  const std::string& before,
                                                  const std::string& after) {
  std::map<std::pair<std::string, int>, Pair> pairs;
  for (const records::TrialRow& trial : trials) {
    if (!trial.counts() || trial.ticks == 0) continue;
    Pair& pair = pairs[{trial.episode, trial.repetition}];
    if (trial.arm == before) pair.first = &trial;
    if (trial.arm == after) pair.second = &trial;
  }
  std::map<int, std::vector<Pair>> groups;
  for (const auto& [key, pair] : pairs) {
    if (pair.first == nullptr || pair.second == nullptr) continue;
    groups[(pair.first->success ? 2 : 0) + (pair.second->success ? 1 : 0)].push_back(pair);
  }
  return groups;
}

/// Speed at which a pair takes no longer than kPair_s: a multiple of 0.5.
double speed_for(const DemoPair& pair, double least) {
  const double wanted = std::max(pair.before->sim_s, pair.after->sim_s) / kPair_s;
  return std::max(least, std::ceil(2.0 * wanted) / 2.0);
}

std::string names_of(const std::vector<records::SceneRow>& scenes) {
  std::string names;
  for (const records::SceneRow& scene : scenes) {
    if (scene.reconstruction > 1) continue;
    names += (names.empty() ? "" : ", ") + (scene.title.empty() ? scene.name : scene.title);
  }
  return names;
}

std::string title_of(const results::StoredRun& stored, const std::string& scene) {
  for (const records::SceneRow& row : stored.scenes) {
    if (row.name == scene && !row.title.empty()) return row.title;
  }
  return scene;
}

}  // namespace

std::vector<DemoPair> choose_demo_pairs(const std::vector<records::TrialRow>& trials,
                                        const std::string& before, const std::string& after) {
  enum Group : int { kNeither, kOnlyAfter, kOnlyBefore, kBoth };
  std::map<int, std::vector<Pair>> groups = pairs_by_outcome(trials, before, after);
  std::vector<DemoPair> chosen;
  const auto add = [&](std::vector<Pair> from, std::size_t count, const std::string& what) {
    const Pair& pair = median_pair(from);
    chosen.push_back({pair.first, pair.second, one_of(count, what)});
  };
  const std::vector<Pair>& better = groups[kOnlyAfter];
  if (!better.empty()) {
    const std::string what = "in which only \"" + after + "\" succeeded";
    add(better, better.size(), what);
    std::vector<Pair> elsewhere;
    for (const Pair& pair : better) {
      if (pair.first->scene != chosen.front().before->scene) elsewhere.push_back(pair);
    }
    if (!elsewhere.empty()) {
      add(elsewhere, elsewhere.size(), what + ", in the other scenes");
    }
  }
  if (!groups[kOnlyBefore].empty()) {
    add(groups[kOnlyBefore], groups[kOnlyBefore].size(),
        "in which only \"" + before + "\" succeeded");
  } else if (!groups[kNeither].empty()) {
    add(groups[kNeither], groups[kNeither].size(), "in which neither succeeded");
  }
  if (chosen.empty() && !groups[kBoth].empty()) {
    add(groups[kBoth], groups[kBoth].size(), "in which both succeeded");
  }
  return chosen;
}

VideoSummary write_demo_video(const results::StoredRun& stored, const DemoOptions& options) {
  const results::ResultTable table = results::summarise(stored, options.before, options.after);
  if (table.before.empty()) {
    throw core::InputError::expected(stored.folder.string(), "a run with two arms to compare",
                                     std::to_string(stored.arms.size()) + " arms");
  }
  // Of several trainings the first is shown.
  const results::TrainingSummary& training = table.trainings.front();
  const std::vector<DemoPair> pairs =
      choose_demo_pairs(stored.trials, training.before, training.arm);
  if (pairs.empty()) {
    throw core::InputError::expected(stored.folder.string(),
                                     "an episode that both arms have finished", "none");
  }
  std::int64_t ticks = 0;
  for (const DemoPair& pair : pairs) ticks += pair.before->ticks + pair.after->ticks;
  core::Progress progress("demo", ticks);
  std::int64_t done = 0;
  const auto on_tick = [&] { progress.update(std::min(++done, ticks)); };

  video::internal::VideoFile file(options.video.output, kFrames_per_s);
  const auto show = [&file](const cv::Mat& card, double duration_s) {
    file.write(card);
    file.hold(duration_s - 1.0 / kFrames_per_s);
  };
  show(internal::title_card(
           "Does this perception change make the robot reach its goal more often, in time?",
           {table.run.title + ".",
            "The same search, robot, starts and goals; the detector alone differs: \"" +
                table.before + "\" against \"" + table.after + "\".",
            "Places: " + names_of(stored.scenes) +
                core::print(".  Trials: %d of %d planned.", table.finished_trials,
                            table.run.planned_trials)}),
       kTitle_s);
  show(internal::reading_card(table.before, table.after), kReading_s);
  TrialPlayer player(stored, options.video.data);
  for (const DemoPair& pair : pairs) {
    const std::string title = title_of(stored, pair.before->scene) + ": find " +
                              sim::with_article(pair.before->goal_class);
    const double speed = speed_for(pair, options.video.speed);
    show(internal::title_card(
             title, {pair.reason, "Episode " + pair.before->episode +
                                      core::print(", shown at %g times its speed.", speed)}),
         kPairTitle_s);
    internal::append_pair(player, *pair.before, *pair.after, title,
                          core::print("%g x real time", speed), speed / kFrames_per_s, on_tick,
                          file);
    file.hold(kOutcome_s);
  }
  show(internal::result_card(table), kResult_s);
  file.finish();
  progress.finish();
  return {file.frames(), file.duration_s(), false};
}

}  // namespace segsim::experiments::films
