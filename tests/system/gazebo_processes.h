#pragma once

/// @file
/// The executable and its peer (gazebo_peer.cpp) as processes of their own, each pair alone on
/// the transport: a partition of its own, loopback only.

#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "sim/ground/robot.h"

namespace segsim::tests {

/// One child with its output in a file; killed if it is still there in the end.
class Process {
 public:
  Process(const std::vector<std::string>& command, const std::string& partition,
          std::filesystem::path output)
      : output_(std::move(output)) {
    std::vector<char*> arguments;
    for (const std::string& word : command)
      arguments.push_back(const_cast<char*>(word.c_str()));
    arguments.push_back(nullptr);
    pid_ = ::fork();
    if (pid_ != 0) return;
    ::setenv("IGN_PARTITION", partition.c_str(), 1);
    ::setenv("IGN_IP", "127.0.0.1", 1);
    ::unsetenv("GZ_PARTITION");
    if (std::freopen(output_.c_str(), "w", stdout) == nullptr) ::_exit(126);
    ::dup2(STDOUT_FILENO, STDERR_FILENO);
    ::execv(arguments[0], arguments.data());
    ::_exit(127);
  }
  ~Process() {
    if (running()) {
      send(SIGCONT);
      send(SIGKILL);
      wait(60.0);
    }
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  void send(int signal_number) const { ::kill(pid_, signal_number); }
  [[nodiscard]] bool running() {
    if (exit_code_ == kRunning) poll();
    return exit_code_ == kRunning;
  }
  /// Exit code; 128 + signal; kRunning if it did not end in time.
  int wait(double patience_s) {
    const auto end = Clock::now() + std::chrono::duration<double>(patience_s);
    while (running() && Clock::now() < end) std::this_thread::sleep_for(kStep);
    return exit_code_;
  }
  int stop(int signal_number = SIGINT) {
    send(signal_number);
    return wait(60.0);
  }
  [[nodiscard]] std::string output() const {
    std::ostringstream text;
    text << std::ifstream(output_).rdbuf();
    return text.str();
  }
  /// Until its output holds the words.
  bool says(const std::string& words, double patience_s) {
    const auto end = Clock::now() + std::chrono::duration<double>(patience_s);
    while (Clock::now() < end) {
      if (output().find(words) != std::string::npos) return true;
      if (!running()) break;
      std::this_thread::sleep_for(kStep);
    }
    return output().find(words) != std::string::npos;
  }
  /// Lines "name value" of a peer; 0 for what it did not say.
  [[nodiscard]] double value(const std::string& name) const {
    std::istringstream lines(output());
    for (std::string line; std::getline(lines, line);) {
      if (line.rfind(name + " ", 0) == 0) return std::atof(line.c_str() + name.size());
    }
    return 0.0;
  }
  [[nodiscard]] double resident_mb() const {
    std::ifstream status("/proc/" + std::to_string(pid_) + "/status");
    for (std::string line; std::getline(status, line);) {
      if (line.rfind("VmRSS:", 0) == 0) return std::atof(line.c_str() + 6) / 1024.0;
    }
    return 0.0;
  }

  static constexpr int kRunning = -1;

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kStep{20};

  void poll() {
    int status = 0;
    if (::waitpid(pid_, &status, WNOHANG) != pid_) return;
    exit_code_ = WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
  }

  std::filesystem::path output_;
  pid_t pid_ = -1;
  int exit_code_ = kRunning;
};

/// Number after the first appearance of `words` in a text; -1 without.
inline double number_after(const std::string& text, const std::string& words) {
  const std::size_t at = text.find(words);
  return at == std::string::npos ? -1.0 : std::atof(text.c_str() + at + words.size());
}

/// Number before the first appearance of `words`; 0 without.
inline double number_before(const std::string& text, const std::string& words) {
  const std::size_t at = text.find(" " + words);
  if (at == std::string::npos || at == 0) return 0.0;
  const std::size_t space = text.rfind(' ', at - 1);
  return std::atof(text.c_str() + (space == std::string::npos ? 0 : space + 1));
}

/// A drive of the simulator's robot between the two rooms of TinyScene, as the recorded poses
/// that the peer plays: one line "x y yaw" for each 1 / rate_hz.
inline void record_drive(const std::filesystem::path& file, double rate_hz,
                         double duration_s) {
  sim::Robot robot(sim::RobotModel::jackal_gentle(), {-2.0, -1.0, 0.3});
  std::ofstream out(file);
  out.precision(17);
  for (int i = 0; i < static_cast<int>(duration_s * rate_hz); ++i) {
    const core::Pose2& pose = robot.state().pose;
    out << pose.x_m << " " << pose.y_m << " " << pose.yaw_rad << "\n";
    const double t_s = i / rate_hz;
    robot.step({0.4, 0.6 * std::sin(0.7 * t_s)}, 1.0 / rate_hz);
  }
}

}  // namespace segsim::tests
