#pragma once

/// @file
/// A dashboard on a free port.

#include <unistd.h>

#include <memory>
#include <string>
#include <thread>

#include <gtest/gtest.h>

#include "experiments/dashboard/dashboard.h"
#include "experiments/runs/run.h"
#include "raw_http.h"
#include "tiny_scene.h"
#include "tiny_spec.h"

namespace segsim::experiments {

class ServedFolder {
 public:
  explicit ServedFolder(const std::filesystem::path& root, const std::string& token = {},
                        const std::string& host = "127.0.0.1")
      : dashboard_(options(root, token, host)), thread_([this] { dashboard_.serve(); }) {
    while (get("/favicon.ico").status == 0) std::this_thread::yield();
  }
  ~ServedFolder() {
    dashboard_.stop();
    thread_.join();
  }
  ServedFolder(const ServedFolder&) = delete;
  ServedFolder& operator=(const ServedFolder&) = delete;

  [[nodiscard]] Answer ask(const std::string& method, const std::string& path,
                           const std::string& headers = {},
                           const std::string& host = "localhost") const {
    return send_raw(dashboard_.port(), request_head(method, path, headers, host));
  }
  [[nodiscard]] Answer get(const std::string& path, const std::string& headers = {}) const {
    return ask("GET", path, headers);
  }
  [[nodiscard]] std::string address(const std::string& path) const {
    return "http://127.0.0.1:" + std::to_string(dashboard_.port()) + path;
  }
  [[nodiscard]] int port() const { return dashboard_.port(); }
  [[nodiscard]] std::string home() const { return dashboard_.address(); }

  /// Of the only run; waits for it.
  [[nodiscard]] std::string only_run() const {
    for (int k = 0; k < 200; ++k) {
      const nlohmann::json runs = get("/api/runs").json().at("runs");
      if (runs.size() == 1) return runs[0].at("key");
      ::usleep(50'000);
    }
    ADD_FAILURE() << "no run, or several";
    return {};
  }

 private:
  static dashboard::DashboardOptions options(const std::filesystem::path& root,
                                             const std::string& token,
                                             const std::string& host) {
    dashboard::DashboardOptions of;
    of.roots = {root};
    of.host = host;
    of.port = 0;
    of.token = token;
    return of;
  }
  dashboard::Dashboard dashboard_;
  std::thread thread_;
};

/// Trials of two arms whose rows are made up: "after" succeeds in four of five, "before" in
/// one of five.
inline records::TrialRow made_up_trial(int episode, const std::string& arm) {
  records::TrialRow trial;
  trial.arm = arm;
  trial.scene = "room";
  trial.goal_class = "couch";
  trial.episode = "room/couch/" + std::to_string(episode);
  trial.success = arm == "after" ? episode % 5 != 4 : episode % 5 == 0;
  trial.outcome =
      trial.success ? records::TrialOutcome::kSuccess : records::TrialOutcome::kTimeout;
  trial.why.cause =
      trial.success ? records::Cause::kDidNotFail : records::Cause::kFalseNegative;
  return trial;
}

inline std::int64_t begin_made_up_run(records::Store& store, int episodes) {
  records::RunRow run;
  run.name = "demo";
  run.title = "Demo <b>&";
  run.success_profile = "segsim-object: STOP";
  run.planned_trials = 2 * episodes;
  return store.begin_run(run, {{"room", "Room", "s", "e", episodes}},
                         {{"before", "a", "c", "", -1, {}}, {"after", "b", "d", "", -1, {}}});
}

/// Two rooms, one couch; a trial takes some 0.1 s.
inline specs::ExperimentSpec tiny_spec(specs::SpecFolders& folders, int episodes) {
  const TinySpec text{.episodes = episodes, .more = "title: Two rooms\n"};
  return specs::parse_spec(text.text(), "tiny.yaml", folders);
}

}  // namespace segsim::experiments
