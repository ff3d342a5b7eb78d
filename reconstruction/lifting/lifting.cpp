#include "reconstruction/lifting/lifting.h"

#include <algorithm>
#include <chrono>
#include <map>

#include <tbb/task_arena.h>

#include "core/check.h"
#include "core/error.h"
#include "core/quantile.h"
#include "reconstruction/lifting/internal/lift_frame.h"
#include "reconstruction/lifting/internal/plane_filling.h"
#include "reconstruction/lifting/internal/voxel_cleaning.h"
#include "reconstruction/lifting/internal/voxel_fusion.h"
#include "reconstruction/lifting/internal/voxel_surfels.h"
#include "reconstruction/lifting/parallel_loading.h"

namespace segsim::reconstruction {
namespace {

using internal::Voxel;

constexpr int kThinRounds = 2;
constexpr std::size_t kSmallestIsland = 40;  ///< Voxels; 160 cm2 at 2 cm.

void check_options(const LiftOptions& options) {
  SEGSIM_CHECK(options.voxel_m >= 1e-3, std::to_string(options.voxel_m));
  SEGSIM_CHECK(options.min_depth_m > 0.0 && options.max_depth_m > options.min_depth_m,
               std::to_string(options.max_depth_m));
  SEGSIM_CHECK(options.opacity > 0.0 && options.opacity <= 1.0,
               std::to_string(options.opacity));
}

/// Runs the stages and reports them.
class Lifter {
 public:
  Lifter(const RgbdSequence& sequence, const LiftOptions& options,
         const LiftProgress& progress)
      : sequence_(sequence),
        options_(options),
        progress_(progress),
        voxel_m_(static_cast<float>(options.voxel_m)),
        frames_(split_frames(sequence.frame_count(), options.frame_step,
                             options.held_out_every)) {}

  LiftResult run();

 private:
  std::vector<Voxel> fuse(LiftStatistics& statistics);
  void clean(std::vector<Voxel>& voxels, LiftStatistics& statistics);
  void report(const std::string& stage, std::size_t done, std::size_t total) const {
    if (progress_) {
      progress_(stage, static_cast<std::int64_t>(done), static_cast<std::int64_t>(total));
    }
  }

  const RgbdSequence& sequence_;
  const LiftOptions& options_;
  const LiftProgress& progress_;
  float voxel_m_;
  FrameSplit frames_;
};

std::vector<Voxel> Lifter::fuse(LiftStatistics& statistics) {
  internal::VoxelFusion fusion(voxel_m_);
  const std::vector<std::size_t>& frames = frames_.used;
  for (std::size_t first = 0; first < frames.size(); first += internal::kFramesInMemory) {
    std::vector<internal::FrameSamples> batch(
        std::min(internal::kFramesInMemory, frames.size() - first));
    internal::load_each(batch.size(), [&](std::size_t k) {
      batch[k] = internal::sample_frame(sequence_.load(frames[first + k]),
                                        sequence_.intrinsics(), options_, sequence_.sensor());
    });
    for (const internal::FrameSamples& samples : batch) {
      statistics.pixels_valid += samples.pixels_valid;
      statistics.pixels_dropped += samples.pixels_dropped;
    }
    fusion.add(batch);
    report("fusing frames", first + batch.size(), frames.size());
  }
  return fusion.take_sorted();
}

void Lifter::clean(std::vector<Voxel>& voxels, LiftStatistics& statistics) {
  constexpr std::size_t kSteps = 4;
  const std::string stage = "cleaning voxels";
  statistics.voxels = voxels.size();
  statistics.voxels_sparse = internal::remove_sparse(voxels, options_.min_observations);
  report(stage, 1, kSteps);
  const internal::FreeSpace free_space(sequence_, frames_.used, options_.carve_frames,
                                       options_);
  statistics.voxels_carved = internal::carve(voxels, free_space, voxel_m_);
  statistics.voxels_outlier += internal::remove_islands(voxels, kSmallestIsland);
  report(stage, 2, kSteps);
  for (int round = 0; round < kThinRounds; ++round) {
    voxels = internal::thin_surfaces(voxels, voxel_m_);
  }
  statistics.voxels_outlier += internal::remove_islands(voxels, kSmallestIsland / 2);
  report(stage, 3, kSteps);
  if (options_.fill_holes && options_.carve_frames > 0) {
    statistics.voxels_filled = internal::fill_planes(voxels, free_space, voxel_m_);
  }
  report(stage, kSteps, kSteps);
}

LiftResult Lifter::run() {
  const auto start = std::chrono::steady_clock::now();
  LiftResult result;
  LiftStatistics& statistics = result.statistics;
  statistics.frames_used = frames_.used.size();
  statistics.frames_held_out = frames_.held_out.size();
  std::vector<Voxel> voxels = fuse(statistics);
  clean(voxels, statistics);
  if (voxels.empty()) {
    throw core::InputError::expected(
        sequence_.name(), "depth that several pixels agree on",
        std::to_string(statistics.pixels_valid) + " depth pixels in range and no surface");
  }
  report("making surfels", 0, 1);
  internal::SurfelReport surfel_report;
  result.surfels =
      internal::make_surfels(voxels, options_, sequence_.has_masks(), surfel_report);
  statistics.voxels_outlier += surfel_report.outliers;
  statistics.label_agreement = surfel_report.label_agreement;
  result.classes = sequence_.classes();
  result.instances = instance_boxes(result.surfels, sequence_.instances());
  for (const std::size_t i : frames_.used) {
    result.camera_positions_m.push_back(sequence_.pose(i).translation_m());
  }
  report("making surfels", 1, 1);
  statistics.seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return result;
}

}  // namespace

std::vector<core::SceneInstance> instance_boxes(
    const renderer::SurfelCloud& surfels, const std::vector<core::SceneInstance>& known) {
  std::map<std::uint16_t, std::vector<std::size_t>> members;
  for (std::size_t i = 0; i < surfels.instance_id.size(); ++i) {
    if (surfels.instance_id[i] != 0) members[surfels.instance_id[i]].push_back(i);
  }
  std::vector<core::SceneInstance> instances;
  for (core::SceneInstance instance : known) {
    const auto found = members.find(instance.id);
    if (found == members.end()) continue;
    for (int axis = 0; axis < 3; ++axis) {
      std::vector<float> values;
      for (const std::size_t i : found->second) values.push_back(surfels.position_m[i][axis]);
      instance.box_min_m[axis] = core::quantile(values, 0.01, core::Between::kNearest);
      instance.box_max_m[axis] = core::quantile(values, 0.99, core::Between::kNearest);
    }
    instances.push_back(std::move(instance));
  }
  return instances;
}

std::vector<std::pair<std::string, double>> LiftStatistics::listing() const {
  return {{"frames_used", static_cast<double>(frames_used)},
          {"frames_held_out", static_cast<double>(frames_held_out)},
          {"pixels_valid", static_cast<double>(pixels_valid)},
          {"pixels_dropped", static_cast<double>(pixels_dropped)},
          {"voxels", static_cast<double>(voxels)},
          {"voxels_sparse", static_cast<double>(voxels_sparse)},
          {"voxels_carved", static_cast<double>(voxels_carved)},
          {"voxels_outlier", static_cast<double>(voxels_outlier)},
          {"voxels_filled", static_cast<double>(voxels_filled)},
          {"label_agreement", label_agreement},
          {"lift_seconds", seconds}};
}

FrameSplit split_frames(std::size_t frame_count, int frame_step, int held_out_every) {
  SEGSIM_CHECK(frame_step >= 1, std::to_string(frame_step));
  FrameSplit split;
  for (std::size_t i = 0; i < frame_count; ++i) {
    if (held_out_every > 1 && i % static_cast<std::size_t>(held_out_every) == 0) {
      split.held_out.push_back(i);
    } else if (i % static_cast<std::size_t>(frame_step) == 0) {
      split.used.push_back(i);
    }
  }
  return split;
}

LiftResult lift(const RgbdSequence& sequence, const LiftOptions& options,
                const LiftProgress& progress) {
  check_options(options);
  tbb::task_arena arena(options.threads > 0 ? options.threads : tbb::task_arena::automatic);
  return arena.execute([&] { return Lifter(sequence, options, progress).run(); });
}

}  // namespace segsim::reconstruction
