#include "experiments/dashboard/internal/scene_viewer.h"

#include <algorithm>

#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "core/formatted.h"
#include "experiments/drawing/box_picture.h"
#include "experiments/drawing/frame_picture.h"
#include "experiments/drawing/goal_boxes.h"
#include "experiments/drawing/map_canvas.h"
#include "experiments/support/append_bytes.h"
#include "renderer/cpu_renderer.h"

namespace segsim::experiments::dashboard::internal {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr std::size_t kScenes = 2, kLogs = 16, kImages = 400;
constexpr int kFloorSide_px = 1400, kImageWidth_px = 480, kJpegQuality = 82;
constexpr int kRenderThreads = 2;
constexpr float kFaintest = 0.2F;  // Opacity of a surfel that becomes a point.

std::string jpeg(const cv::Mat& image) {
  return drawing::encoded(image, ".jpg", kJpegQuality);
}

/// To the width of a pane, both ways.
cv::Mat fitted(const cv::Mat& image, int interpolation) {
  const double scale = static_cast<double>(kImageWidth_px) / image.cols;
  cv::Mat pane;
  cv::resize(image, pane, cv::Size(), scale, scale,
             scale < 1.0 ? cv::INTER_AREA : interpolation);
  return pane;
}

core::Image<core::Rgb8> reduced_floor(const core::Image<core::Rgb8>& floor) {
  const int side = std::max(floor.width_px(), floor.height_px());
  if (side <= kFloorSide_px) return floor;
  const double scale = static_cast<double>(kFloorSide_px) / side;
  cv::Mat small;
  cv::resize(drawing::to_bgr(floor), small, cv::Size(), scale, scale, cv::INTER_AREA);
  return drawing::from_bgr(small);
}

template <class Value>
Value* remembered(std::list<std::pair<std::string, Value>>& list, const std::string& key) {
  for (auto at = list.begin(); at != list.end(); ++at) {
    if (at->first != key) continue;
    list.splice(list.begin(), list, at);
    return &list.front().second;
  }
  return nullptr;
}

template <class Value>
void remember(std::list<std::pair<std::string, Value>>& list, const std::string& key,
              Value value, std::size_t most) {
  list.emplace_front(key, std::move(value));
  if (list.size() > most) list.pop_back();
}

std::uint8_t as_byte(float value) {
  return static_cast<std::uint8_t>(std::clamp(255.0F * value + 0.5F, 0.0F, 255.0F));
}

}  // namespace

std::string point_bytes(const renderer::SurfelCloud& surfels, std::size_t most) {
  std::vector<std::size_t> solid;
  for (std::size_t k = 0; k < surfels.size(); ++k) {
    if (surfels.opacity[k] >= kFaintest) solid.push_back(k);
  }
  const std::size_t count = std::min(most, solid.size());
  std::string bytes, colors, classes;
  support::append_bytes(bytes, static_cast<std::uint32_t>(count));
  for (std::size_t n = 0; n < count; ++n) {
    const std::size_t k = solid[n * solid.size() / count];
    support::append_bytes(bytes, surfels.position_m[k]);
    const glm::vec3 color = 0.5F + renderer::kShC0 * surfels.sh[k * surfels.sh_count()];
    support::append_bytes(colors,
                          core::Rgb8{as_byte(color.x), as_byte(color.y), as_byte(color.z)});
    support::append_bytes(
        classes, drawing::id_color(surfels.has_labels() ? surfels.semantic_id[k] : 0));
  }
  return bytes + colors + classes;
}

fs::path bundle_of(const results::StoredRun& stored, const records::TrialLog& log) {
  return log.bundle.is_absolute() ? log.bundle : stored.folder / log.bundle;
}

SceneViewer::Scene& SceneViewer::scene(const fs::path& bundle) {
  for (auto at = scenes_.begin(); at != scenes_.end(); ++at) {
    if (at->first != bundle) continue;
    scenes_.splice(scenes_.begin(), scenes_, at);
    return scenes_.front().second;
  }
  Scene fresh;
  fresh.bundle = core::load_bundle(bundle);
  fresh.surfels = scenes::load_scene_surfels(fresh.bundle);
  fresh.plan = drawing::make_floor_plan(*fresh.surfels.surfels);
  fresh.floor = reduced_floor(fresh.plan.rgb);
  renderer::RenderOptions options;
  options.threads = kRenderThreads;
  fresh.renderer =
      renderer::make_cpu_renderer(fresh.surfels.surfels, options, fresh.surfels.labels);
  scenes_.emplace_front(bundle, std::move(fresh));
  if (scenes_.size() > kScenes) scenes_.pop_back();
  return scenes_.front().second;
}

std::string SceneViewer::floor_json(const fs::path& bundle) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const Scene& of = scene(bundle);
  const double scale =
      static_cast<double>(of.floor.width_px()) / std::max(1, of.plan.rgb.width_px());
  Json json{{"title", of.bundle.manifest.name},
            {"origin", {of.plan.origin_m.x, of.plan.origin_m.y}},
            {"px_per_m", of.plan.px_per_m * scale},
            {"size", {of.floor.width_px(), of.floor.height_px()}},
            {"surfels", of.surfels.surfels->size()},
            {"objects", Json::array()}};
  for (const core::SceneInstance& i : of.bundle.manifest.instances) {
    json["objects"].push_back({{"id", i.id},
                               {"name", i.name},
                               {"class", of.bundle.manifest.class_name(i.class_id)},
                               {"low", {i.box_min_m.x, i.box_min_m.y, i.box_min_m.z}},
                               {"high", {i.box_max_m.x, i.box_max_m.y, i.box_max_m.z}}});
  }
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string SceneViewer::floor_jpeg(const fs::path& bundle) {
  const std::lock_guard<std::mutex> lock(mutex_);
  return jpeg(drawing::to_bgr(scene(bundle).floor));
}

std::string SceneViewer::points(const fs::path& bundle) {
  const std::lock_guard<std::mutex> lock(mutex_);
  return point_bytes(*scene(bundle).surfels.surfels);
}

std::shared_ptr<const records::TrialLog> SceneViewer::log(const results::StoredRun& stored,
                                                          const records::TrialRow& trial) {
  if (trial.log.empty()) {
    throw core::InputError::expected("trial " + std::to_string(trial.trial_id), "a log",
                                     "none (a trial that failed, or of an older version)");
  }
  const std::string file = (stored.folder / trial.log).string();
  const std::lock_guard<std::mutex> lock(mutex_);
  // A trial that failed may run again under the same name: its number tells them apart.
  const std::string key = std::to_string(trial.trial_id) + file;
  if (const auto* known = remembered(logs_, key)) return *known;
  auto fresh = std::make_shared<const records::TrialLog>(records::read_trial_log(file));
  remember(logs_, key, fresh, kLogs);
  return fresh;
}

std::string SceneViewer::trial_image(const results::StoredRun& stored,
                                     const records::TrialRow& trial, std::size_t tick,
                                     TrialImage which) {
  const std::shared_ptr<const records::TrialLog> of = log(stored, trial);
  if (tick >= of->track.size()) {
    throw core::InputError::expected("tick", "0 to " + std::to_string(of->track.size() - 1),
                                     std::to_string(tick));
  }
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto key = [&](TrialImage image) {
    return (stored.folder / trial.log).string() + "\n" + std::to_string(trial.trial_id) +
           "\n" + std::to_string(tick) + (image == TrialImage::kCamera ? "c" : "p");
  };
  if (const std::string* known = remembered(images_, key(which))) return *known;
  Scene& place = scene(bundle_of(stored, *of));
  core::Frame frame;
  place.renderer->render(core::transform_from_pose2<core::frame::World>(of->track[tick].pose) *
                             core::mast_camera(of->camera_height_m, of->camera_pitch_down_rad),
                         of->camera, core::Channels::kRgb | core::Channels::kLabels, frame);
  const sim::GoalObjects goal(place.bundle.manifest, of->episode);
  const double scale = static_cast<double>(kImageWidth_px) / of->camera.width_px;
  const core::Image<core::Rgb8> seen = drawing::draw_boxes(
      frame.rgb, drawing::goal_boxes(frame, goal), {}, {of->episode.goal_name()}, scale);
  remember(images_, key(TrialImage::kCamera), jpeg(drawing::to_bgr(seen)), kImages);
  remember(images_, key(TrialImage::kPanoptic),
           jpeg(fitted(drawing::to_bgr(drawing::panoptic_picture(frame)), cv::INTER_NEAREST)),
           kImages);
  return *remembered(images_, key(which));
}

}  // namespace segsim::experiments::dashboard::internal
