#include "experiments/scenes/recording_check.h"

#include <cstdio>
#include <string>
#include <vector>

#include <glm/geometric.hpp>

#include "core/error.h"
#include "core/formatted.h"
#include "experiments/drawing/recording_plan.h"
#include "perception/data/image_file.h"
#include "reconstruction/inspection/image_checks.h"
#include "reconstruction/inspection/inspect_recording.h"
#include "reconstruction/inspection/space_checks.h"
#include "reconstruction/inspection/view_directions.h"

namespace segsim::experiments::scenes {
namespace {

using reconstruction::Finding;

double walked_m(const std::vector<core::CameraPose>& path) {
  double sum_m = 0.0;
  for (std::size_t i = 1; i < path.size(); ++i) {
    sum_m += glm::distance(path[i - 1].translation_m(), path[i].translation_m());
  }
  return sum_m;
}

drawing::RecordingPlan plan_of(const reconstruction::RgbdSequence& sequence,
                               const reconstruction::RecordingSample& sample) {
  constexpr std::size_t kPoints = 400'000;
  drawing::RecordingPlan plan;
  plan.title = core::print("%s: %zu frames, %.1f m", sequence.name().c_str(),
                           sequence.frame_count(), walked_m(sample.path));
  plan.points_m = reconstruction::sample_points_m(sample, kPoints);
  plan.path = sample.path;
  plan.horizontal_fov_rad = sequence.intrinsics().horizontal_fov_rad();
  for (const std::size_t k : reconstruction::blurred_samples(sample)) {
    plan.marked.push_back(sample.frames[k].frame);
  }
  const auto sectors =
      reconstruction::count_directions(sample.path, sequence.intrinsics()).frames_of_sector;
  plan.frames_of_sector.assign(sectors.begin(), sectors.end());
  return plan;
}

}  // namespace

void check_recording(const reconstruction::RgbdSequence& sequence,
                     const std::filesystem::path& picture) {
  const reconstruction::RecordingSample sample = reconstruction::sample_recording(sequence);
  const std::vector<Finding> findings = reconstruction::inspect_recording(sequence, sample);
  std::printf("%s: %zu frames, %zu of them looked at, path of %.1f m\n",
              sequence.name().c_str(), sequence.frame_count(), sample.frames.size(),
              walked_m(sample.path));
  for (const Finding& finding : findings) {
    std::printf("%s\n", reconstruction::line_of(finding).c_str());
  }
  std::printf(
      "%s\n",
      findings.empty()
          ? "nothing stands out"
          : core::print("%zu findings; docs/datasets.md says more", findings.size()).c_str());
  perception::write_image(picture, drawing::draw_recording_plan(plan_of(sequence, sample)));
  std::printf("%s: where cameras looked, from above\n", picture.string().c_str());
}

void refuse_wrong_poses(const reconstruction::RgbdSequence& sequence, bool insisted) {
  for (const Finding& finding : reconstruction::inspect_briefly(sequence)) {
    const std::string line = reconstruction::line_of(finding);
    if (finding.defeats && !insisted) {
      throw core::InputError(sequence.name() + ": " + line +
                             "; to go on as it is, --pose-scale 1");
    }
    std::fprintf(stderr, "warning: %s\n", line.c_str());
  }
}

}  // namespace segsim::experiments::scenes
