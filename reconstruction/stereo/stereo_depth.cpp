#include "reconstruction/stereo/stereo_depth.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <mutex>
#include <numbers>
#include <span>
#include <sstream>
#include <vector>

#include <tbb/task_arena.h>
#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "core/check.h"
#include "core/error.h"
#include "core/quantile.h"
#include "reconstruction/lifting/lifting.h"
#include "reconstruction/lifting/parallel_loading.h"
#include "reconstruction/stereo/internal/depth_folder.h"
#include "reconstruction/stereo/internal/plane_sweep.h"
#include "reconstruction/stereo/internal/semi_global.h"
#include "reconstruction/stereo/internal/slanted_refinement.h"
#include "reconstruction/stereo/internal/source_views.h"
#include "reconstruction/stereo/internal/view_consistency.h"
#include "reconstruction/stereo/internal/working_view.h"

namespace segsim::reconstruction {
namespace {

using core::InputError;
using internal::DepthRange;
using internal::MatchedView;
using internal::SourceViews;
using internal::WorkingView;

constexpr double kNearest_m = 0.3, kFarthestAtLeast_m = 6.0, kBeyondCameras_m = 4.0;
constexpr int kCompared = 8;
constexpr int kCoarseWidth_px = 80;
constexpr std::size_t kFewestSources = 2;
constexpr double kFewestMatched = 0.25, kFewestKnown = 0.02;
constexpr std::size_t kFewestPoints = 30;

/// Quantiles of depth with room on both sides, within `whole`.
DepthRange range_of(const std::vector<float>& depths_m, const DepthRange& whole) {
  const auto at = [&](double share) {
    return static_cast<double>(core::quantile(depths_m, share, core::Between::kNearest));
  };
  constexpr double kRoom = 1.3;
  DepthRange range;
  range.near_m = std::clamp(at(0.005) / kRoom, whole.near_m, 0.5 * whole.far_m);
  range.far_m = std::clamp(at(0.995) * kRoom, 2.0 * range.near_m, whole.far_m);
  range.middle_m = std::clamp(at(0.5), range.near_m, range.far_m);
  return range;
}

/// Diagonal of the box, along the axes, that holds all cameras.
double extent_m(const std::vector<core::CameraPose>& poses) {
  glm::dvec3 low = poses.front().translation_m(), high = low;
  for (const core::CameraPose& pose : poses) {
    low = glm::min(low, pose.translation_m());
    high = glm::max(high, pose.translation_m());
  }
  return glm::distance(low, high);
}

/// Runs the stages and reports them.
class Matcher {
 public:
  Matcher(const RgbdSequence& sequence, const StereoOptions& options,
          const std::filesystem::path& folder, const StereoProgress& progress);

  StereoReport run();

 private:
  void load_views();
  void find_whole_range();
  void find_ranges();
  void choose_sources();
  void match();
  void agree(StereoReport& report);
  [[nodiscard]] MatchedView match_coarsely(
      std::size_t view, const std::vector<core::Image<std::uint16_t>>& small,
      const core::CameraIntrinsics& camera, const SourceViews& sources) const;
  [[nodiscard]] std::string recipe() const;
  [[nodiscard]] std::vector<internal::ViewWarp> warps_of(
      std::size_t view, std::span<const std::uint32_t> sources,
      const core::CameraIntrinsics& camera) const;

  /// Calls body(k) for all views at once, with a progress line.
  template <class Body>
  void for_each_view(const std::string& stage, const Body& body) const {
    std::mutex mutex;
    std::int64_t done = 0;
    const auto total = static_cast<std::int64_t>(frames_.size());
    if (progress_) progress_(stage, 0, total);
    internal::load_each(frames_.size(), [&](std::size_t k) {
      body(k);
      const std::lock_guard lock(mutex);
      if (progress_) progress_(stage, ++done, total);
    });
  }

  const RgbdSequence& sequence_;
  const StereoOptions& options_;
  const StereoProgress& progress_;
  std::vector<std::size_t> frames_;  ///< Of the sequence, by view.
  core::CameraIntrinsics camera_;
  internal::DepthFolder folder_;
  std::vector<WorkingView> views_;
  std::vector<core::CameraPose> poses_;
  DepthRange whole_;
  std::vector<DepthRange> ranges_;
  std::vector<SourceViews> sources_;
  std::vector<MatchedView> matched_;
  std::vector<char> resumed_;
};

Matcher::Matcher(const RgbdSequence& sequence, const StereoOptions& options,
                 const std::filesystem::path& folder, const StereoProgress& progress)
    : sequence_(sequence),
      options_(options),
      progress_(progress),
      frames_(split_frames(sequence.frame_count(), options.frame_step, options.held_out_every)
                  .used),
      folder_(folder) {
  const core::CameraIntrinsics& recorded = sequence.intrinsics();
  const int width_px = std::min(options.width_px, recorded.width_px);
  const double scale = static_cast<double>(width_px) / recorded.width_px;
  camera_ = recorded.resized(
      width_px, std::max(1, static_cast<int>(std::lround(scale * recorded.height_px))));
}

void Matcher::load_views() {
  if (frames_.size() < kFewestSources + 1) {
    throw InputError::expected(sequence_.name(), "at least 3 frames to find depth by stereo",
                               std::to_string(frames_.size()));
  }
  views_.resize(frames_.size());
  for (const std::size_t i : frames_) poses_.push_back(sequence_.pose(i));
  for_each_view("reading pictures", [&](std::size_t k) {
    const RgbdFrame frame = sequence_.load(frames_[k]);
    WorkingView& view = views_[k];
    view.grey = internal::grey_of(frame.rgb, camera_.width_px, camera_.height_px);
    view.T_world_camera = poses_[k];
    const auto T_camera_world = poses_[k].inverse();
    for (const glm::dvec3& p_m : sequence_.seen_points_m(frames_[k])) {
      const glm::dvec3 p_camera_m =
          (T_camera_world * core::Point<core::frame::World>{p_m}).xyz_m;
      if (p_camera_m.z > 0.0) view.points_m.emplace_back(p_camera_m);
    }
  });
}

void Matcher::find_whole_range() {
  if (options_.depth_range_m) {
    whole_.near_m = options_.depth_range_m->first;
    whole_.far_m = options_.depth_range_m->second;
  } else {
    std::vector<float> depths_m;
    for (const WorkingView& view : views_) {
      for (const glm::vec3& p_m : view.points_m) depths_m.push_back(p_m.z);
    }
    if (depths_m.size() >= kFewestPoints) {
      // Sparse points lie on corners: surfaces between them reach further.
      whole_.near_m = 0.5 * core::quantile(depths_m, 0.005, core::Between::kNearest);
      whole_.far_m = 1.5 * core::quantile(depths_m, 0.995, core::Between::kNearest);
    } else {
      whole_.near_m = kNearest_m;
      whole_.far_m = std::max(kFarthestAtLeast_m, extent_m(poses_) + kBeyondCameras_m);
    }
  }
  whole_.middle_m = std::sqrt(whole_.near_m * whole_.far_m);
}

std::vector<internal::ViewWarp> Matcher::warps_of(std::size_t view,
                                                  std::span<const std::uint32_t> sources,
                                                  const core::CameraIntrinsics& camera) const {
  std::vector<internal::ViewWarp> warps;
  for (const std::uint32_t source : sources) {
    warps.push_back(internal::warp_between(poses_[view], poses_[source], camera));
  }
  return warps;
}

MatchedView Matcher::match_coarsely(std::size_t view,
                                    const std::vector<core::Image<std::uint16_t>>& small,
                                    const core::CameraIntrinsics& camera,
                                    const SourceViews& sources) const {
  MatchedView matched;
  matched.T_world_camera = poses_[view];
  matched.inverse_m = core::Image<float>(camera.width_px, camera.height_px, std::nanf(""));
  if (sources.matched.empty()) return matched;
  std::vector<const core::Image<std::uint16_t>*> pictures;
  for (const std::uint32_t source : sources.matched) pictures.push_back(&small[source]);
  const auto warps = warps_of(view, sources.matched, camera);
  const auto planes = internal::sweep_planes(whole_, warps, camera);
  matched.step_inverse_m = planes.step_inverse_m;
  matched.inverse_m = internal::semi_global(
      internal::sweep(small[view], pictures, warps, planes), small[view]);
  return matched;
}

void Matcher::find_ranges() {
  const std::vector<DepthRange> everywhere(views_.size(), whole_);
  const int factor = std::max(1, camera_.width_px / kCoarseWidth_px);
  std::vector<core::Image<std::uint16_t>> small;
  for (const WorkingView& view : views_) small.push_back(internal::shrunk(view.grey, factor));
  // Cut as the pictures are, so that a small pixel is factor x factor pixels.
  core::CameraIntrinsics camera = camera_;
  camera.width_px = small.front().width_px(), camera.height_px = small.front().height_px();
  camera.fx_px /= factor, camera.fy_px /= factor;
  camera.cx_px /= factor, camera.cy_px /= factor;
  std::vector<SourceViews> sources(views_.size());
  std::vector<MatchedView> coarse(views_.size());
  for_each_view("looking for the range of depth", [&](std::size_t k) {
    sources[k] =
        internal::choose_sources(k, poses_, everywhere, camera_, options_.sources, kCompared);
    coarse[k] = match_coarsely(k, small, camera, sources[k]);
  });
  ranges_.resize(views_.size());
  internal::load_each(views_.size(), [&](std::size_t k) {
    std::vector<float> depths_m;
    if (views_[k].points_m.size() >= kFewestPoints) {
      for (const glm::vec3& p_m : views_[k].points_m) depths_m.push_back(p_m.z);
    } else {
      // What no other view confirms would only widen the range.
      const core::Image<float> depth_m =
          internal::agreed_depth(k, sources[k].compared, coarse, camera, 1);
      for (const float z : depth_m.pixels()) {
        if (z > 0.0F) depths_m.push_back(z);
      }
      if (10 * depths_m.size() < depth_m.size()) depths_m.clear();
    }
    ranges_[k] = depths_m.empty() ? whole_ : range_of(depths_m, whole_);
  });
}

void Matcher::choose_sources() {
  sources_.resize(views_.size());
  internal::load_each(views_.size(), [&](std::size_t k) {
    sources_[k] =
        internal::choose_sources(k, poses_, ranges_, camera_, options_.sources, kCompared);
  });
  const auto matched = static_cast<std::size_t>(
      std::count_if(sources_.begin(), sources_.end(),
                    [](const SourceViews& s) { return s.matched.size() >= kFewestSources; }));
  if (static_cast<double>(matched) >= kFewestMatched * static_cast<double>(views_.size())) {
    return;
  }
  std::vector<double> middles_m;
  for (const DepthRange& range : ranges_) middles_m.push_back(range.middle_m);
  const double middle_m = core::quantile(middles_m, 0.5, core::Between::kNearest);
  char wanted[160], found[200];
  std::snprintf(wanted, sizeof wanted,
                "frames that show the same surfaces from places about %.2g m apart, to find "
                "depth by stereo",
                middle_m * std::tan(internal::wanted_angle_rad(camera_)));
  std::snprintf(found, sizeof found,
                "%zu of %zu frames with two such others; all cameras lie within %.2g m (one "
                "that only turns shows no depth)",
                matched, views_.size(), extent_m(poses_));
  throw InputError::expected(sequence_.name() + ", poses", wanted, found);
}

std::string Matcher::recipe() const {
  std::ostringstream text;
  text.precision(17);
  text << "stereo 1\n"
       << camera_.width_px << ' ' << camera_.height_px << ' ' << camera_.fx_px << ' '
       << camera_.fy_px << ' ' << camera_.cx_px << ' ' << camera_.cy_px << '\n'
       << options_.sources << ' ' << whole_.near_m << ' ' << whole_.far_m << '\n';
  for (std::size_t k = 0; k < views_.size(); ++k) {
    // Where the world's origin lies does not matter: only the way from the first camera.
    const auto T = poses_.front().inverse() * poses_[k];
    const auto rounded = [](double value) { return std::round(value * 1e6) * 1e-6 + 0.0; };
    text << frames_[k] << ' ' << rounded(std::abs(T.rotation().w)) << ' '
         << rounded(T.translation_m().x) << ' ' << rounded(T.translation_m().y) << ' '
         << rounded(T.translation_m().z) << ' ' << views_[k].points_m.size() << ' '
         << internal::digest_of(views_[k].grey) << '\n';
  }
  return text.str();
}

void Matcher::match() {
  matched_.resize(views_.size());
  resumed_.assign(views_.size(), 0);
  for_each_view("matching", [&](std::size_t k) {
    MatchedView& view = matched_[k];
    view.T_world_camera = poses_[k];
    view.inverse_m = core::Image<float>(camera_.width_px, camera_.height_px, std::nanf(""));
    const std::vector<std::uint32_t>& sources = sources_[k].matched;
    if (sources.size() < kFewestSources) return;
    const auto warps = warps_of(k, sources, camera_);
    const auto planes = internal::sweep_planes(ranges_[k], warps, camera_);
    view.step_inverse_m = planes.step_inverse_m;
    if (auto found = folder_.read_matched(frames_[k]);
        found && found->width_px() == camera_.width_px &&
        found->height_px() == camera_.height_px) {
      view.inverse_m = std::move(*found);
      resumed_[k] = 1;
      return;
    }
    std::vector<const core::Image<std::uint16_t>*> pictures;
    pictures.reserve(sources.size());
    for (const std::uint32_t source : sources) pictures.push_back(&views_[source].grey);
    const core::Image<std::uint16_t>& own = views_[k].grey;
    internal::CostVolume volume = internal::sweep(own, pictures, warps, planes);
    internal::seed_costs(views_[k].points_m, camera_, volume);
    view.inverse_m = internal::semi_global(volume, own);
    internal::refine_slanted(own, pictures, warps, planes.step_inverse_m, view.inverse_m);
    folder_.write_matched(frames_[k], view.inverse_m, camera_, poses_[k]);
  });
}

void Matcher::agree(StereoReport& report) {
  std::vector<std::size_t> known(views_.size());
  for_each_view("comparing views", [&](std::size_t k) {
    const core::Image<float> depth_m = internal::agreed_depth(
        k, sources_[k].compared, matched_, camera_, options_.fewest_views);
    known[k] = static_cast<std::size_t>(std::count_if(
        depth_m.pixels().begin(), depth_m.pixels().end(), [](float z) { return z > 0.0F; }));
    folder_.write_depth(frames_[k], depth_m, camera_, poses_[k]);
  });
  std::size_t sum = 0;
  for (const std::size_t count : known) sum += count;
  report.known_share = static_cast<double>(sum) / (static_cast<double>(views_.size()) *
                                                   camera_.width_px * camera_.height_px);
  if (report.known_share >= kFewestKnown) return;
  char found[200];
  std::snprintf(
      found, sizeof found,
      "views that agree on the depth of %.2g %% of the pixels (--invert-poses if the "
      "files hold the inverses; --depth-range if surfaces lie elsewhere)",
      100.0 * report.known_share);
  throw InputError::expected(sequence_.name(), "pictures that fit their poses", found);
}

StereoReport Matcher::run() {
  const auto start = std::chrono::steady_clock::now();
  StereoReport report;
  load_views();
  find_whole_range();
  find_ranges();
  choose_sources();
  folder_.begin(recipe());
  match();
  agree(report);
  report.frames = views_.size();
  for (std::size_t k = 0; k < views_.size(); ++k) {
    report.frames_matched += sources_[k].matched.size() >= kFewestSources ? 1 : 0;
    report.frames_resumed += resumed_[k] != 0 ? 1 : 0;
  }
  report.near_m = whole_.near_m, report.far_m = whole_.far_m;
  report.seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return report;
}

}  // namespace

StereoReport estimate_depth(const RgbdSequence& sequence, const StereoOptions& options,
                            const std::filesystem::path& folder,
                            const StereoProgress& progress) {
  SEGSIM_CHECK(options.width_px >= 32, std::to_string(options.width_px));
  SEGSIM_CHECK(options.sources >= 2, std::to_string(options.sources));
  if (options.depth_range_m) {
    const auto [near_m, far_m] = *options.depth_range_m;
    SEGSIM_CHECK(near_m > 0.0 && far_m > near_m, "depth range");
  }
  tbb::task_arena arena(options.threads > 0 ? options.threads : tbb::task_arena::automatic);
  return arena.execute([&] { return Matcher(sequence, options, folder, progress).run(); });
}

}  // namespace segsim::reconstruction
