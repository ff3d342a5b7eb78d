#include "experiments/trials/live_view.h"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <ostream>

#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>

#include "core/system/remakeable_file.h"
#include "core/system/system_random.h"
#include "experiments/drawing/frame_picture.h"
#include "experiments/drawing/map_canvas.h"

namespace segsim::experiments::trials {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using Seconds = std::chrono::duration<double>;

constexpr double kLookEvery_s = 1.0, kWriteEvery_s = 0.5;
/// A file follows the one before after this many times of what that one took.
constexpr double kRestFactor = 120.0;
constexpr std::size_t kStrip = 240;  // Ticks of the latency strip.
constexpr double kPathStep_m = 0.05;
constexpr int kPictureWidth_px = 320, kJpegQuality = 75;

double ms_since(std::chrono::steady_clock::time_point start) {
  return 1e3 * Seconds(std::chrono::steady_clock::now() - start).count();
}

/// "host-5be27d01-0": unique among the workers of all machines and containers that share a
/// folder.
std::string worker_name() {
  static std::atomic<int> count{0};
  char host[256] = {};
  std::string name = gethostname(host, sizeof host - 1) == 0 ? host : "host";
  std::replace_if(
      name.begin(), name.end(),
      [](char c) { return std::isalnum(static_cast<unsigned char>(c)) == 0; }, '_');
  static const std::string process = core::random_hex(4);
  return name + "-" + process + "-" + std::to_string(count++);
}

std::string encoded_picture(const core::Image<core::Rgb8>& image) {
  cv::Mat bgr = drawing::to_bgr(image);
  if (bgr.cols > kPictureWidth_px) {
    const double scale = static_cast<double>(kPictureWidth_px) / bgr.cols;
    cv::resize(bgr, bgr, cv::Size(), scale, scale, cv::INTER_AREA);
  }
  return drawing::encoded(bgr, ".jpg", kJpegQuality);
}

/// One grey level per kind of cell, first row at the smallest y.
std::string encoded_cells(const core::Image<std::uint8_t>& cells) {
  cv::Mat grey(cells.height_px(), cells.width_px(), CV_8UC1);
  for (int y = 0; y < grey.rows; ++y) {
    for (int x = 0; x < grey.cols; ++x) {
      grey.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(85 * cells(x, y));
    }
  }
  return drawing::encoded(grey, ".png", kJpegQuality);
}

double rounded(double value) { return std::round(value * 1e3) / 1e3; }
Json json_point(const glm::dvec2& p_m) { return {rounded(p_m.x), rounded(p_m.y)}; }
Json json_points(std::span<const glm::dvec2> points_m) {
  Json json = Json::array();
  for (const glm::dvec2& p_m : points_m) json.push_back(json_point(p_m));
  return json;
}

}  // namespace

LiveView::LiveView(const fs::path& results)
    : marker_(results / kLiveFolder / kLiveMarker),
      file_(results / kLiveFolder / (worker_name() + kLiveEnding)) {}

LiveView::~LiveView() {
  std::error_code ignored;
  if (written_) fs::remove(file_, ignored);
}

void LiveView::begin(LiveTrial trial) {
  trial_ = std::move(trial);
  ticks_ = 0;
  path_.clear();
  times_.clear();
  pending_ = {};
  last_tick_.reset();
}

double LiveView::watched_s() const {
  return first_write_ ? Seconds(Clock::now() - *first_write_).count() : 0.0;
}

bool LiveView::due(Clock::time_point now) {
  if (broken_) return false;
  if (now >= next_look_) {
    next_look_ = now + std::chrono::duration_cast<Clock::duration>(Seconds(kLookEvery_s));
    std::error_code error;
    const auto touched = fs::last_write_time(marker_, error);
    watched_ =
        !error &&
        std::abs(Seconds(fs::file_time_type::clock::now() - touched).count()) < kWatchedFor_s;
  }
  return watched_ && now >= next_write_;
}

void LiveView::add(const sim::TickRecord& tick, const core::Frame& frame,
                   std::span<const core::Detection> detections, const core::Policy& policy) {
  const Clock::time_point now = Clock::now();
  pending_.tick = ticks_++;
  pending_.total_ms = last_tick_ ? 1e3 * Seconds(now - *last_tick_).count() : 0.0;
  pending_.render_ms = frame.stats.render_ms;
  pending_.age_ms = 1e3 * core::seconds(tick.age_ns);
  times_.push_back(pending_);
  if (times_.size() > kStrip) times_.pop_front();
  pending_ = {};
  const glm::dvec2 at_m{tick.pose.x_m, tick.pose.y_m};
  if (path_.empty() || glm::distance(path_.back().first, at_m) >= kPathStep_m) {
    path_.emplace_back(at_m, tick.mode);
  }
  if (due(now)) {
    if (!first_write_) first_write_ = now;
    try {
      write(tick, frame, detections, policy.view());
      written_ = true;
    } catch (const std::exception&) {
      broken_ = true;  // A full disk, a folder that went away: the trial does not care.
    }
    const double took_s = 1e-3 * ms_since(now);
    spent_s_ += took_s;
    const double rest_s = std::max(kWriteEvery_s, kRestFactor * took_s);
    next_write_ = now + std::chrono::duration_cast<Clock::duration>(Seconds(rest_s));
  }
  last_tick_ = Clock::now();
}

void LiveView::write(const sim::TickRecord& tick, const core::Frame& frame,
                     std::span<const core::Detection> detections,
                     const core::PolicyView& view) {
  std::vector<std::pair<std::string, std::string>> parts;
  if (!frame.rgb.empty()) parts.emplace_back("camera.jpg", encoded_picture(frame.rgb));
  if (!frame.semantic.empty()) {
    parts.emplace_back("panoptic.jpg", encoded_picture(drawing::panoptic_picture(frame)));
  }
  if (!view.cells.empty()) parts.emplace_back("cells.png", encoded_cells(view.cells));
  core::write_remakeable_file(file_, [&](std::ostream& out) {
    out << header(tick, frame, detections, view, parts) << '\n';
    for (const auto& [name, bytes] : parts) out << bytes;
  });
}

std::string LiveView::header(
    const sim::TickRecord& tick, const core::Frame& frame,
    std::span<const core::Detection> detections, const core::PolicyView& view,
    const std::vector<std::pair<std::string, std::string>>& parts) const {
  Json json{{"schema", kLiveSchema},
            {"worker", file_.stem().string()},
            {"trial",
             {{"scene", trial_.scene},
              {"scene_title", trial_.scene_title},
              {"arm", trial_.arm},
              {"episode", trial_.episode},
              {"goal_class", trial_.goal_class},
              {"goal_instances", trial_.goal_instances},
              {"repetition", trial_.repetition},
              {"time_limit_s", trial_.time_limit_s},
              {"start", {trial_.start.x_m, trial_.start.y_m, trial_.start.yaw_rad}},
              {"way", json_points(trial_.shortest_path_m)},
              {"bundle", trial_.bundle.string()}}},
            {"tick",
             {{"index", ticks_ - 1},
              {"time_s", core::seconds(tick.time_ns)},
              {"mode", core::to_string(tick.mode)},
              {"pose", {tick.pose.x_m, tick.pose.y_m, tick.pose.yaw_rad}},
              {"command", {tick.command.forward_mps, tick.command.turn_radps}},
              {"contact", tick.in_contact},
              {"goal_pixels", tick.goal_pixels},
              {"age_ms", 1e3 * core::seconds(tick.age_ns)}}},
            {"camera", {frame.intrinsics.width_px, frame.intrinsics.height_px}},
            {"detections", Json::array()},
            {"path", Json::array()},
            {"frontiers", json_points(view.frontiers_m)},
            {"plan", json_points(view.path_m)},
            {"target", view.target_m ? json_point(*view.target_m) : Json()},
            {"objects", Json::array()},
            {"cells",
             {{"origin", json_point(view.origin_m)},
              {"resolution_m", view.resolution_m},
              {"size", {view.cells.width_px(), view.cells.height_px()}}}},
            {"cost", {{"spent_s", rounded(spent_s_)}, {"of_s", rounded(watched_s())}}},
            {"stages", Json::array()},
            {"parts", Json::array()}};
  for (const core::Detection& d : detections) {
    const auto index = static_cast<std::size_t>(d.class_index);
    const std::string name =
        index < trial_.detector_classes.size() ? trial_.detector_classes[index] : "?";
    json["detections"].push_back({name, rounded(d.score), d.box.x0, d.box.y0, d.box.x1,
                                  d.box.y1, d.class_index == trial_.goal_index});
  }
  for (const auto& [p_m, mode] : path_) {
    json["path"].push_back({rounded(p_m.x), rounded(p_m.y), static_cast<int>(mode)});
  }
  for (const core::PolicyView::Object& o : view.objects) {
    json["objects"].push_back({rounded(o.position_m.x), rounded(o.position_m.y),
                               o.class_index == trial_.goal_index, rounded(o.score)});
  }
  for (const StageTimes& t : times_) {
    json["stages"].push_back({t.tick, rounded(t.total_ms), rounded(t.render_ms),
                              rounded(t.detect_ms), rounded(t.policy_ms), rounded(t.age_ms)});
  }
  for (const auto& [name, bytes] : parts) json["parts"].push_back({name, bytes.size()});
  // Bytes of foreign names that are no UTF-8 become U+FFFD instead of an exception.
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::vector<core::Detection> TimedDetector::detect(const core::Observation& seen) {
  const auto start = std::chrono::steady_clock::now();
  std::vector<core::Detection> detections = inner_.detect(seen);
  live_.note_detect(ms_since(start));
  return detections;
}

core::Decision TimedPolicy::decide(const core::Observation& seen,
                                   std::span<const core::Detection> detections) {
  const auto start = std::chrono::steady_clock::now();
  core::Decision decision = inner_.decide(seen, detections);
  live_.note_policy(ms_since(start));
  return decision;
}

}  // namespace segsim::experiments::trials
