#include "reconstruction/inspection/finding.h"

#include "core/name_table.h"
#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::reconstruction {
namespace {

constexpr core::NameTable<FindingKind, FindingKind::kDepthHoles> kWords(
    "a kind of finding",
    {"loading", "few frames", "inverted poses", "wrong unit", "poses and depth disagree",
     "repeated frames", "frame gap", "fast camera", "motion blur", "directions not looked at",
     "floor unseen", "calibration", "clocks", "open loop", "holes in depth"});

}  // namespace

std::string words_of(FindingKind kind) { return kWords.name(kind); }

std::string line_of(const Finding& finding) {
  return words_of(finding.kind) + ": " + (finding.where.empty() ? "" : finding.where + ": ") +
         finding.how_bad + (finding.help.empty() ? "" : "; " + finding.help);
}

std::string frames_text(const RgbdSequence& sequence, const std::vector<std::size_t>& frames) {
  constexpr int kMostRuns = 4;
  std::string text = frames.size() == 1 ? "frame " : "frames ";
  int runs = 0;
  std::size_t named = 0;
  while (named < frames.size() && runs < kMostRuns) {
    std::size_t last = named;
    while (last + 1 < frames.size() && frames[last + 1] == frames[last] + 1) ++last;
    text += (runs++ > 0 ? ", " : "") + sequence.frame_name(frames[named]);
    if (last > named) text += " to " + sequence.frame_name(frames[last]);
    named = last + 1;
  }
  if (named < frames.size()) text += " and " + std::to_string(frames.size() - named) + " more";
  return text;
}

}  // namespace segsim::reconstruction
