#include "experiments/dashboard/dashboard.h"

#include <charconv>
#include <cmath>
#include <optional>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/dashboard/internal/dashboard_assets.h"
#include "experiments/dashboard/internal/live_files.h"
#include "experiments/dashboard/internal/run_index.h"
#include "experiments/dashboard/internal/run_json.h"
#include "experiments/dashboard/internal/scene_viewer.h"
#include "experiments/report/report_assets.h"
#include "experiments/results/explanation.h"
#include "experiments/web/pages.h"

namespace segsim::experiments::dashboard {
namespace {

namespace fs = std::filesystem;
using internal::Json;
using internal::RunPointer;
using web::binary_reply;
using web::HttpReply;
using web::HttpRequest;
using web::not_found;

constexpr std::size_t kTrialsPerPage = 100;

/// A whole number without sign or space.
std::optional<std::int64_t> number_of(const std::string& text) {
  std::int64_t value = 0;
  const char* end = text.data() + text.size();
  const auto [at, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || at != end || value < 0) return std::nullopt;
  return value;
}

HttpReply json_reply(const Json& json) { return web::json_reply(internal::json_text(json)); }

/// Asks the workers of a run for pictures, and reads what they have sent so far. Those of a
/// run that is over are left alone: asking would put a folder beside its results.
struct LiveAnswer {
  bool could_ask = true;
  std::vector<internal::LiveFile> files;
};
LiveAnswer ask_workers(const internal::RunSnapshot& run) {
  LiveAnswer answer;
  if (!run.stored.run.ended.empty()) return answer;
  for (const fs::path& folder : run.live_folders) {
    answer.could_ask = internal::ask_for_live_files(folder) && answer.could_ask;
  }
  answer.files = internal::read_live_files(run.live_folders);
  return answer;
}

/// A library of the distribution, from the one place where it is installed.
HttpReply library_reply(const fs::path& file, const char* package) {
  std::error_code error;
  if (file.empty() || !fs::exists(file, error)) {
    return not_found(std::string("the package ") + package + " is not installed");
  }
  return web::file_reply(web::kScriptType, core::read_file(file));
}

Json json_points(const std::vector<glm::dvec2>& points_m) {
  Json json = Json::array();
  for (const glm::dvec2& p : points_m) json.push_back({p.x, p.y});
  return json;
}

Json json_log(const results::StoredRun& stored, const records::TrialRow& trial,
              const records::TrialLog& log) {
  Json json{
      {"run", stored.run.title.empty() ? stored.run.name : stored.run.title},
      {"trial", internal::trial_json(trial)},
      {"scene_title", log.scene_title},
      {"goal_class", log.episode.goal_name()},
      {"goal_instances", log.episode.goal_instances},
      {"stop_reason", core::to_string(log.stop_reason)},
      {"time_limit_s", log.time_limit_s},
      {"camera", {log.camera.width_px, log.camera.height_px}},
      {"start", {log.episode.start.x_m, log.episode.start.y_m, log.episode.start.yaw_rad}},
      {"view_points", json_points(log.episode.view_points_m)},
      {"way", json_points(log.shortest_path_m)},
      {"ticks", Json::array()},
      {"detections", Json::array()},
      {"moments", Json::array()},
      {"story", results::tell_story(trial, log)}};
  for (std::size_t k = 0; k < log.track.size(); ++k) {
    const sim::TickRecord& t = log.track[k];
    json["ticks"].push_back(
        {core::seconds(t.time_ns), t.pose.x_m, t.pose.y_m, t.pose.yaw_rad,
         t.command.forward_mps, t.command.turn_radps, static_cast<int>(t.mode),
         t.in_contact ? 1 : 0, log.evidence[k].largest_px,
         std::isfinite(log.distance_m[k]) ? Json(log.distance_m[k]) : Json()});
  }
  for (const records::JudgedDetection& d : log.detections) {
    json["detections"].push_back(
        {d.tick, d.score, d.box.x0, d.box.y0, d.box.x1, d.box.y1, d.is_goal ? 1 : 0});
  }
  for (const results::KeyMoment& moment : results::key_moments(trial, log)) {
    json["moments"].push_back({moment.tick, moment.what});
  }
  return json;
}

}  // namespace

struct Dashboard::Impl {
  internal::RunIndex index;
  internal::SceneViewer viewer;
  std::unique_ptr<web::HttpServer> server;

  explicit Impl(const DashboardOptions& options) : index(options.roots) {}

  [[nodiscard]] HttpReply answer(const HttpRequest& request) {
    const std::vector<std::string>& parts = request.parts;
    if (parts.size() < 2) {
      const std::string name = parts.empty() ? "runs.html" : parts[0];
      return web::page(name, internal::find_asset(name));
    }
    if (parts[0] == "static" && parts.size() == 2) return static_file(parts[1]);
    if (parts[0] == "api" && parts[1] == "runs") {
      if (parts.size() == 2) return all_runs();
      const RunPointer run = index.find(parts[2]);
      if (run == nullptr) return not_found("no such run");
      return of_run(*run, {parts.begin() + 3, parts.end()}, request);
    }
    return not_found("nothing here");
  }

  static HttpReply static_file(const std::string& name) {
    if (name == "chart.min.js")
      return library_reply(report::internal::kChartLibrary, "libjs-chart.js");
    if (name == "three.min.js") return library_reply(internal::kThreeLibrary, "libjs-three");
    if (name == "OrbitControls.js") {
      return library_reply(internal::kOrbitControls, "libjs-three");
    }
    return web::file_of_pages(name, internal::find_asset(name));
  }

  HttpReply all_runs() {
    Json json{{"runs", Json::array()}, {"problems", Json::array()}};
    const std::string now = records::utc_now();
    for (const RunPointer& run : index.runs()) {
      json["runs"].push_back(internal::overview_json(*run, ask_workers(*run).files, now));
    }
    for (const std::string& problem : index.problems()) json["problems"].push_back(problem);
    return json_reply(json);
  }

  /// @param rest  Of the address, below /api/runs/KEY/.
  HttpReply of_run(const internal::RunSnapshot& run, const std::vector<std::string>& rest,
                   const HttpRequest& request) {
    if (rest.empty()) return whole_run(run);
    if (rest[0] == "trials" && rest.size() == 1) {
      const auto found = request.query.find("offset");
      const auto offset = found == request.query.end() ? 0 : number_of(found->second);
      if (!offset) return not_found("offset: expected a number");
      return json_reply(
          internal::trials_json(run, static_cast<std::size_t>(*offset), kTrialsPerPage));
    }
    if (rest[0] == "workers" && rest.size() == 3) {
      const auto part = internal::read_live_part(run.live_folders, rest[1], rest[2]);
      if (!part) return not_found("no such picture of a worker");
      return binary_reply(rest[2].ends_with(".png") ? "image/png" : "image/jpeg", *part,
                          false);
    }
    if (rest[0] == "scenes" && rest.size() == 3) return of_scene(run, rest[1], rest[2]);
    if (rest[0] == "trials" && rest.size() >= 2) {
      const auto id = number_of(rest[1]);
      for (const records::TrialRow& trial : run.stored.trials) {
        if (id && trial.trial_id == *id) {
          return of_trial(run, trial, {rest.begin() + 2, rest.end()});
        }
      }
      return not_found("no such trial");
    }
    return not_found("nothing here");
  }

  static HttpReply whole_run(const internal::RunSnapshot& run) {
    const LiveAnswer live = ask_workers(run);
    Json json = internal::overview_json(run, live.files, records::utc_now());
    json["can_ask"] = live.could_ask;
    json["live"] = Json::array();
    for (const internal::LiveFile& file : live.files) {
      Json worker = Json::parse(file.header);
      worker["worker"] = file.worker;
      worker["age_s"] = file.age_s;
      json["live"].push_back(std::move(worker));
    }
    return json_reply(json);
  }

  /// The bundle that trials of a scene ran in, or run in now.
  [[nodiscard]] std::optional<fs::path> bundle(const internal::RunSnapshot& run,
                                               const std::string& scene) {
    for (const records::TrialRow& trial : run.stored.trials) {
      std::error_code error;
      if (trial.scene != scene || trial.log.empty()) continue;
      if (!fs::exists(run.stored.folder / trial.log, error)) continue;
      return internal::bundle_of(run.stored, *viewer.log(run.stored, trial));
    }
    for (const internal::LiveFile& file : internal::read_live_files(run.live_folders)) {
      const Json trial = Json::parse(file.header).value("trial", Json::object());
      if (trial.value("scene", "") == scene) return fs::path(trial.value("bundle", ""));
    }
    return std::nullopt;
  }

  /// @param scene  Its number in the list of the run.
  HttpReply of_scene(const internal::RunSnapshot& run, const std::string& scene,
                     const std::string& what) {
    const auto number = number_of(scene);
    if (!number || static_cast<std::size_t>(*number) >= run.stored.scenes.size()) {
      return not_found("no such scene");
    }
    const auto place = bundle(run, run.stored.scenes[static_cast<std::size_t>(*number)].name);
    if (!place) return not_found("no trial says yet where the scene lies");
    if (what == "floor.json")
      return {200, "application/json", viewer.floor_json(*place), true};
    if (what == "floor.jpg")
      return binary_reply("image/jpeg", viewer.floor_jpeg(*place), true);
    if (what == "points.bin") {
      return binary_reply("application/octet-stream", viewer.points(*place), true);
    }
    return not_found("no such picture of a scene");
  }

  HttpReply of_trial(const internal::RunSnapshot& run, const records::TrialRow& trial,
                     const std::vector<std::string>& rest) {
    if (rest.empty()) {
      Json json = json_log(run.stored, trial, *viewer.log(run.stored, trial));
      json["scene_number"] = nullptr;
      for (std::size_t k = 0; k < run.stored.scenes.size(); ++k) {
        if (run.stored.scenes[k].name == trial.scene) json["scene_number"] = k;
      }
      json["others"] = Json::array();
      for (const records::TrialRow& other : run.stored.trials) {
        if (other.episode != trial.episode) continue;
        json["others"].push_back(internal::trial_json(other));
      }
      return json_reply(json);
    }
    const auto tick = rest.size() == 2 && rest[1].ends_with(".jpg")
                          ? number_of(rest[1].substr(0, rest[1].size() - 4))
                          : std::nullopt;
    if (!tick || (rest[0] != "camera" && rest[0] != "panoptic")) {
      return not_found("no such picture of a trial");
    }
    const auto which =
        rest[0] == "camera" ? internal::TrialImage::kCamera : internal::TrialImage::kPanoptic;
    return binary_reply(
        "image/jpeg",
        viewer.trial_image(run.stored, trial, static_cast<std::size_t>(*tick), which), true);
  }
};

Dashboard::Dashboard(const DashboardOptions& options) {
  impl_ = std::make_unique<Impl>(options);
  impl_->server = std::make_unique<web::HttpServer>(
      options,
      [impl = impl_.get()](const HttpRequest& request) { return impl->answer(request); });
}

Dashboard::~Dashboard() = default;

int Dashboard::port() const { return impl_->server->port(); }
std::string Dashboard::address() const { return impl_->server->address(); }
void Dashboard::serve() { impl_->server->serve(); }
void Dashboard::stop() { impl_->server->stop(); }

}  // namespace segsim::experiments::dashboard
