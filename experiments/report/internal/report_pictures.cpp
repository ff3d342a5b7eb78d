// Pictures of a report: floors with paths, filmstrips, and what the run has drawn itself.
#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <optional>
#include <thread>

#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "core/progress.h"
#include "core/scene_bundle.h"
#include "experiments/drawing/map_canvas.h"
#include "experiments/report/filmstrip.h"
#include "experiments/report/internal/report_model.h"
#include "experiments/results/explanation.h"
#include "experiments/scenes/scene_surfels.h"
#include "perception/data/image_file.h"
#include "renderer/cpu_renderer.h"

namespace segsim::experiments::report::internal {
namespace {

namespace fs = std::filesystem;

constexpr int kJpegQuality = 80;
constexpr int kMapSide_px = 1400, kPictureSide_px = 720;
constexpr double kPathStep_m = 0.1;
constexpr std::uintmax_t kVideoBytes = 20'000'000;  // Of all videos in a report.

core::Image<core::Rgb8> reduced(const core::Image<core::Rgb8>& image, int long_side_px) {
  const int side = std::max(image.width_px(), image.height_px());
  if (side <= long_side_px) return image;
  const double scale = static_cast<double>(long_side_px) / side;
  cv::Mat small;
  cv::resize(drawing::to_bgr(image), small, cv::Size(), scale, scale, cv::INTER_AREA);
  return drawing::from_bgr(small);
}

/// What is drawn of one scene, and with what.
struct SceneStage {
  core::SceneBundle bundle;
  scenes::SceneSurfels surfels;
  drawing::FloorPlan plan;
  double map_scale = 1.0;  ///< Pixels of the report's map per pixel of the plan.
};

/// The floor of the scene as a picture of the report.
SceneStage open_stage(const fs::path& bundle_folder, const fs::path& picture, SceneMap& map) {
  SceneStage stage;
  stage.bundle = core::load_bundle(bundle_folder);
  stage.surfels = scenes::load_scene_surfels(stage.bundle);
  stage.plan = drawing::make_floor_plan(*stage.surfels.surfels);
  const core::Image<core::Rgb8> floor = reduced(stage.plan.rgb, kMapSide_px);
  stage.map_scale = static_cast<double>(floor.width_px()) / stage.plan.rgb.width_px();
  perception::write_image(picture, floor, kJpegQuality);
  map.width_px = floor.width_px();
  map.height_px = floor.height_px();
  return stage;
}

std::vector<glm::dvec2> path_of(const records::TrialLog& log, const SceneStage& stage) {
  std::vector<glm::dvec2> path_px;
  glm::dvec2 last(0.0);
  for (std::size_t k = 0; k < log.track.size(); ++k) {
    const glm::dvec2 at{log.track[k].pose.x_m, log.track[k].pose.y_m};
    const bool ends = k == 0 || k + 1 == log.track.size();
    if (!ends && glm::distance(at, last) < kPathStep_m) continue;
    path_px.push_back(stage.plan.to_px(at) * stage.map_scale);
    last = at;
  }
  return path_px;
}

std::string stem_of(const TrialView& view) { return view.anchor; }

/// Everything of one trial. Others may work on other trials at the same time.
/// @param stage  Null: no bundle. @return  How many pictures were written.
int add_trial(TrialView& view, const results::StoredRun& stored, const fs::path& output,
              bool draw, const SceneStage* stage, core::Renderer* renderer) {
  int pictures = 0;
  std::error_code error;
  if (draw && !view.row->picture.empty() &&
      fs::exists(stored.folder / view.row->picture, error)) {
    view.picture = "pictures/" + stem_of(view) + ".jpg";
    perception::write_image(
        output / view.picture,
        reduced(perception::read_image(stored.folder / view.row->picture), kPictureSide_px),
        kJpegQuality);
    ++pictures;
  }
  if (view.row->log.empty() || !fs::exists(stored.folder / view.row->log, error))
    return pictures;
  const records::TrialLog log = records::read_trial_log(stored.folder / view.row->log);
  view.story = results::tell_story(*view.row, log);
  if (stage == nullptr || log.track.empty()) return pictures;
  view.path_px = path_of(log, *stage);
  view.strip = "strips/" + stem_of(view) + ".jpg";
  perception::write_image(
      output / view.strip,
      draw_filmstrip(*view.row, log, stage->bundle.manifest, stage->plan, *renderer),
      kJpegQuality);
  return pictures + 1;
}

/// The bundle that the trials of a scene ran in, from the first log that names one.
std::optional<fs::path> bundle_of(const results::StoredRun& stored, const std::string& scene) {
  for (const records::TrialRow& row : stored.trials) {
    std::error_code error;
    if (row.scene != scene || row.log.empty()) continue;
    if (!fs::exists(stored.folder / row.log, error)) continue;
    const fs::path bundle = records::read_trial_log(stored.folder / row.log).bundle;
    return bundle.is_absolute() ? bundle : stored.folder / bundle;
  }
  return std::nullopt;
}

void add_videos(ReportModel& model, const fs::path& output) {
  std::uintmax_t bytes = 0;
  int left_out = 0;
  for (TrialView& view : model.trials) {
    std::error_code error;
    const fs::path source = model.stored->folder / view.row->video;
    if (view.row->video.empty() || !fs::exists(source, error)) continue;
    bytes += fs::file_size(source, error);
    if (bytes > kVideoBytes) {
      ++left_out;
      continue;
    }
    view.video = "videos/" + stem_of(view) + source.extension().string();
    fs::create_directories(output / "videos", error);
    if (!fs::copy_file(source, output / view.video, error)) {
      throw core::InputError::expected((output / view.video).string(), "a place for a video",
                                       error.message());
    }
  }
  if (left_out > 0) {
    model.notes.push_back(std::to_string(left_out) +
                          " videos were left out to keep the report small; they are in the "
                          "work folder.");
  }
}

}  // namespace

int add_pictures(ReportModel& model, const fs::path& output, bool draw, int threads) {
  const results::StoredRun& stored = *model.stored;
  if (threads <= 0)
    threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  core::Progress progress("report", static_cast<std::int64_t>(model.trials.size()));
  std::atomic<int> pictures{0}, done{0};
  for (const records::SceneRow& scene : stored.scenes) {
    std::optional<SceneStage> stage;
    const std::optional<fs::path> bundle = draw ? bundle_of(stored, scene.name) : std::nullopt;
    if (bundle) {
      SceneMap map{scene.name, scene.title,
                   "maps/scene-" + std::to_string(&scene - stored.scenes.data()) + ".jpg"};
      try {
        stage = open_stage(*bundle, output / map.image, map);
        model.maps.push_back(map);
        ++pictures;
      } catch (const core::InputError& missing) {
        model.notes.push_back("No map and filmstrips of " + scene.title + ": " +
                              missing.what());
      }
    } else if (draw) {
      model.notes.push_back("No map and filmstrips of " + scene.title +
                            ": its trials have no logs.");
    }

    std::vector<TrialView*> trials;
    for (TrialView& view : model.trials) {
      if (view.row->scene == scene.name) trials.push_back(&view);
    }
    std::atomic<std::size_t> next{0};
    std::mutex mutex;  // Guards the failure and the progress line.
    std::exception_ptr failure;
    const auto work = [&] {
      try {
        std::unique_ptr<core::Renderer> renderer;
        if (stage) {
          renderer::RenderOptions options;
          options.threads = 1;
          renderer = renderer::make_cpu_renderer(stage->surfels.surfels, options,
                                                 stage->surfels.labels);
        }
        for (std::size_t k = next++; k < trials.size(); k = next++) {
          pictures += add_trial(*trials[k], stored, output, draw, stage ? &*stage : nullptr,
                                renderer.get());
          const std::lock_guard<std::mutex> lock(mutex);
          progress.update(++done);
        }
      } catch (...) {
        next = trials.size();
        const std::lock_guard<std::mutex> lock(mutex);
        failure = std::current_exception();
      }
    };
    std::vector<std::thread> workers;
    for (int k = 1; k < threads; ++k) workers.emplace_back(work);
    work();
    for (std::thread& worker : workers) worker.join();
    if (failure) std::rethrow_exception(failure);
  }
  if (draw) add_videos(model, output);
  progress.finish();
  return pictures;
}

}  // namespace segsim::experiments::report::internal
