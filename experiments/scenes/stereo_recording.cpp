#include "experiments/scenes/stereo_recording.h"

#include <cstdio>

#include "core/name_table.h"
#include "core/progress.h"
#include "experiments/scenes/scene_source.h"
#include "experiments/support/stop_signal.h"

namespace segsim::experiments::scenes {
namespace {

constexpr core::NameTable<DepthSource, DepthSource::kNone> kDepthSources("a source of depth",
                                                                         {"auto", "recorded",
                                                                          "stereo", "none"});

void print(const reconstruction::StereoReport& report, const std::filesystem::path& work,
           const std::optional<reconstruction::DepthComparison>& comparison) {
  std::printf("stereo: depth of %.0f %% of the pixels of %zu frames, between %.2g and %.2g m",
              100.0 * report.known_share, report.frames, report.near_m, report.far_m);
  if (report.frames_matched < report.frames) {
    std::printf("; %zu frames share too little with others",
                report.frames - report.frames_matched);
  }
  if (report.frames_resumed > 0) {
    std::printf("; %zu of %zu found in %s", report.frames_resumed, report.frames,
                work.filename().string().c_str());
  }
  std::printf("; %s\n", core::format_duration(report.seconds).c_str());
  if (!comparison) return;
  std::printf(
      "stereo: against the recording's own depth: error %.1f %% (%.1f cm) in the median, %.1f "
      "%% (%.1f cm) at 90 %%; %.0f %% within 5 %%; %.0f %% complete\n",
      100.0 * comparison->median_share, 100.0 * comparison->median_m,
      100.0 * comparison->high_share, 100.0 * comparison->high_m,
      100.0 * comparison->within_5_percent, 100.0 * comparison->completeness());
}

}  // namespace

DepthSource parse_depth_source(const std::string& word, const std::string& place) {
  return kDepthSources.read(word, place);
}

StereoRecording open_with_stereo(const std::filesystem::path& folder,
                                 const std::filesystem::path& boxes,
                                 reconstruction::SequenceOptions options,
                                 const reconstruction::RgbdSequence& recorded,
                                 const reconstruction::StereoOptions& stereo,
                                 const std::filesystem::path& work) {
  std::unique_ptr<core::Progress> progress;
  std::string current;
  StereoRecording result;
  result.report = reconstruction::estimate_depth(
      recorded, stereo, work,
      [&](const std::string& stage, std::int64_t done, std::int64_t total) {
        if (stage != current) {
          current = stage;
          progress = std::make_unique<core::Progress>("stereo: " + stage, total);
        }
        progress->update(done);
        support::StopOnSignal::check();
      });
  progress.reset();
  result.comparison = reconstruction::compare_with_recorded(work, recorded);
  print(result.report, work, result.comparison);
  options.own_depth = work;
  result.sequence = open_recording(folder, boxes, options);
  return result;
}

}  // namespace segsim::experiments::scenes
