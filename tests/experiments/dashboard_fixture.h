#pragma once

/// @file
/// A dashboard on a free port, and a client that sends exactly what it is told to.

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <memory>
#include <string>
#include <thread>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "experiments/dashboard/dashboard.h"
#include "experiments/runs/run.h"
#include "tiny_scene.h"
#include "tiny_spec.h"

namespace segsim::experiments {

struct Answer {
  int status = 0;
  std::string head, body;
  [[nodiscard]] nlohmann::json json() const { return nlohmann::json::parse(body); }
};

/// Sends the bytes and reads until the other side closes.
inline Answer send_raw(int port, const std::string& bytes) {
  const int connection = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::string text;
  if (::connect(connection, reinterpret_cast<const sockaddr*>(&address), sizeof address) ==
          0 &&
      ::send(connection, bytes.data(), bytes.size(), MSG_NOSIGNAL) ==
          static_cast<ssize_t>(bytes.size())) {
    char buffer[65536];
    for (ssize_t size = 1; size > 0;) {
      size = ::recv(connection, buffer, sizeof buffer, 0);
      if (size > 0) text.append(buffer, static_cast<std::size_t>(size));
    }
  }
  ::close(connection);
  Answer answer;
  const std::size_t end = text.find("\r\n\r\n");
  if (end == std::string::npos || text.size() < 12) return answer;
  answer.status = std::stoi(text.substr(9, 3));
  answer.head = text.substr(0, end + 2);
  answer.body = text.substr(end + 4);
  return answer;
}

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
    return send_raw(dashboard_.port(), method + " " + path + " HTTP/1.1\r\nHost: " + host +
                                           "\r\nConnection: close\r\n" + headers + "\r\n");
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
  trial.outcome = trial.success ? "success" : "timeout";
  trial.why.cause = trial.success ? "did_not_fail" : "false_negative";
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
