#include "experiments/films/run_video.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "core/error.h"
#include "core/file_io.h"
#include "core/formatted.h"
#include "core/progress.h"
#include "experiments/films/internal/pages.h"
#include "experiments/films/internal/pair_film.h"
#include "experiments/records/trial_log.h"
#include "experiments/runs/trial_replay.h"
#include "experiments/video/video_file.h"
#include "sim/trial/goal_objects.h"

namespace segsim::experiments::films {
namespace {

namespace fs = std::filesystem;

constexpr double kMostFrames_per_s = 25.0;
constexpr double kHold_s = 2.0;  // The outcome.

std::string name_of(const records::TrialRow& trial) {
  return "trial " + std::to_string(trial.trial_id) + " (" + trial.episode + ", " + trial.arm +
         ")";
}

/// One page per tick, but no more than a screen can show.
double frames_per_s(const results::StoredRun& stored, const records::TrialRow& trial,
                    double speed) {
  if (trial.log.empty()) {
    throw core::InputError::expected(
        name_of(trial), "a log to play again (replays: {of: all} in the spec)", "none");
  }
  const records::TrialLog log = records::read_trial_log(stored.folder / trial.log);
  return std::min(kMostFrames_per_s, speed / log.control_period_s);
}

}  // namespace

struct TrialPlayer::Impl {
  const results::StoredRun& stored;
  fs::path data;
  std::unique_ptr<runs::TrialReplay> replay;
};

TrialPlayer::TrialPlayer(const results::StoredRun& stored, fs::path data)
    : impl_(new Impl{stored, std::move(data), nullptr}) {}

TrialPlayer::~TrialPlayer() = default;

void TrialPlayer::play(const records::TrialRow& trial, trials::TrialViewer& viewer) {
  const fs::path file = records::replay_log_of(impl_->stored.folder, trial);
  if (file.empty() || !fs::exists(file)) {
    throw core::InputError::expected(
        name_of(trial), "a log to play again (replays: {of: all} in the spec)", "none");
  }
  const records::ReplayLog log = records::read_replay_log(file);
  const fs::path work = runs::work_of_replay(file);
  if (impl_->replay == nullptr || !impl_->replay->fits(log, work)) {
    impl_->replay =
        std::make_unique<runs::TrialReplay>(log, specs::SpecFolders{impl_->data, work}, true);
  }
  const records::ReplayLog again = impl_->replay->play(log, file, &viewer);
  const records::Divergence found = records::first_divergence(log.ticks, again.ticks);
  if (found.tick < 0) return;
  throw core::InputError::expected(
      name_of(trial), "the same trial when it is played again",
      "another from tick " + std::to_string(found.tick) + " on (" + found.field + ")");
}

VideoSummary write_trial_video(const results::StoredRun& stored,
                               const records::TrialRow& trial, const VideoOptions& options) {
  const fs::path log = records::replay_log_of(stored.folder, trial);
  const fs::path recorded = trial.video.empty() ? fs::path() : stored.folder / trial.video;
  if ((log.empty() || !fs::exists(log)) && !recorded.empty() && fs::exists(recorded)) {
    core::write_via_temporary(options.output, [&](const fs::path& to) {
      fs::copy_file(recorded, to, fs::copy_options::overwrite_existing);
    });
    return {0, 0.0, true};
  }
  const double rate = frames_per_s(stored, trial, options.speed);
  video::internal::VideoFile file(options.output, rate);
  core::Progress progress("video", std::max(1, trial.ticks));
  int done = 0;
  internal::PageSampler sampler(
      video::internal::PageForm::kWide, options.speed / rate,
      [&file](const cv::Mat& page) { file.write(page); },
      [&] { progress.update(std::min(++done, std::max(1, trial.ticks))); });
  TrialPlayer(stored, options.data).play(trial, sampler);
  if (sampler.pages() == 0) {
    throw core::InputError::expected(name_of(trial), "a trial with an image",
                                     to_string(trial.outcome));
  }
  file.hold(kHold_s);
  file.finish();
  progress.finish();
  return {file.frames(), file.duration_s(), false};
}

namespace internal {

void append_pair(TrialPlayer& player, const records::TrialRow& left,
                 const records::TrialRow& right, const std::string& title,
                 const std::string& note, double step_s, const std::function<void()>& on_tick,
                 video::internal::VideoFile& file) {
  PageTape tape;
  PageSampler first(
      video::internal::PageForm::kColumn, step_s,
      [&tape](const cv::Mat& page) { tape.push(page); }, on_tick);
  player.play(left, first);
  if (tape.empty()) {
    throw core::InputError::expected(name_of(left), "a trial with an image",
                                     to_string(left.outcome));
  }
  std::size_t screens = 0;
  cv::Mat last;
  PageSampler second(
      video::internal::PageForm::kColumn, step_s,
      [&](const cv::Mat& page) {
        file.write(pair_screen(title, note, tape.at(screens++), page));
        last = page;
      },
      on_tick);
  player.play(right, second);
  if (last.empty()) {
    throw core::InputError::expected(name_of(right), "a trial with an image",
                                     to_string(right.outcome));
  }
  for (; screens < tape.size(); ++screens) {
    file.write(pair_screen(title, note, tape.at(screens), last));
  }
}

}  // namespace internal

VideoSummary write_pair_video(const results::StoredRun& stored, const records::TrialRow& left,
                              const records::TrialRow& right, const VideoOptions& options) {
  const double rate = frames_per_s(stored, left, options.speed);
  video::internal::VideoFile file(options.output, rate);
  const std::int64_t ticks = std::max(1, left.ticks + right.ticks);
  core::Progress progress("video", ticks);
  std::int64_t done = 0;
  TrialPlayer player(stored, options.data);
  internal::append_pair(
      player, left, right, "Find " + sim::with_article(left.goal_class) + ",  " + left.episode,
      core::print("%g x real time", options.speed), options.speed / rate,
      [&] { progress.update(std::min(++done, ticks)); }, file);
  file.hold(kHold_s);
  file.finish();
  progress.finish();
  return {file.frames(), file.duration_s(), false};
}

}  // namespace segsim::experiments::films
