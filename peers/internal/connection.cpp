#include "peers/internal/connection.h"

#include <array>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <thread>
#include <utility>

#include <spawn.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include "core/error.h"

namespace segsim::peers::internal {
namespace {

using Clock = Channel::Clock;
constexpr std::size_t kLongestMessage = 1000;  // It stands in every row of a failed trial.
using std::chrono::milliseconds;

Clock::time_point in(double seconds) {
  return Clock::now() +
         std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

/// @param within_s  A program whose queue is full lets others wait.
OwnedFd connect_to(const std::filesystem::path& path, double within_s) {
  sockaddr_un address = {};
  address.sun_family = AF_UNIX;
  const std::string name = path.string();
  if (name.size() >= sizeof(address.sun_path)) {
    throw core::InputError::expected(
        name, "a path shorter than " + std::to_string(sizeof(address.sun_path)) + " bytes",
        std::to_string(name.size()));
  }
  std::memcpy(address.sun_path, name.c_str(), name.size() + 1);
  OwnedFd socket(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  timeval limit = {};
  limit.tv_sec = static_cast<time_t>(std::ceil(within_s));
  if (!socket.is_open() ||
      ::setsockopt(socket.get(), SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof(limit)) != 0) {
    throw core::InputError(name + ": " + std::strerror(errno));
  }
  if (::connect(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) !=
      0) {
    throw core::InputError::expected(name, "a socket on which a program listens",
                                     std::strerror(errno));
  }
  return socket;
}

}  // namespace

ChildProcess::ChildProcess(const std::vector<std::string>& command, const OwnedFd& end) {
  std::vector<char*> arguments;
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_adddup2(&files, end.get(), STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&files, end.get(), STDOUT_FILENO);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  const int error =
      ::posix_spawnp(&pid_, arguments.front(), &files, &attributes, arguments.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&files);
  if (error != 0) {
    throw core::InputError::expected(command.front(), "a program that can be started",
                                     std::strerror(error));
  }
}

/// It is left to be waited for, so that its process group keeps its number.
bool ChildProcess::wait_until(Clock::time_point deadline) {
  while (!end_) {
    siginfo_t found = {};
    const int error =
        ::waitid(P_PID, static_cast<id_t>(pid_), &found, WEXITED | WNOHANG | WNOWAIT);
    if (error == 0 && found.si_pid == pid_) end_ = found;
    if (end_ || (error != 0 && errno != EINTR) || Clock::now() >= deadline) break;
    std::this_thread::sleep_for(milliseconds(2));
  }
  return end_.has_value();
}

ChildProcess::~ChildProcess() {
  (void)wait_until(Clock::now() + std::chrono::seconds(1));
  ::kill(-pid_, SIGKILL);  // Also what it started and left.
  while (::waitpid(pid_, nullptr, 0) < 0 && errno == EINTR) {
  }
}

std::string ChildProcess::end_in_words() {
  if (!wait_until(Clock::now() + milliseconds(200))) return {};
  const std::string number = std::to_string(end_->si_status);
  return end_->si_code == CLD_EXITED ? "ended with exit code " + number
                                     : "was ended by signal " + number;
}

Connection::Connection(const core::PeerCommand& command, const std::string& role,
                       const std::vector<std::string>& goals)
    : name_(role + " \"" + command.in_words() + "\"") {
  if (command.command.empty()) {
    channel_.emplace(connect_to(command.socket, command.start_s), name_);
  } else {
    std::array<int, 2> ends{-1, -1};
    if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) {
      throw core::InputError(name_ + ": " + std::strerror(errno));
    }
    channel_.emplace(OwnedFd(ends[0]), name_);
    const OwnedFd other(ends[1]);
    child_.emplace(command.command, other);
  }
  Json hello = {{"type", "hello"}, {"schema", kSchema}, {"role", role}};
  if (role == "detector") hello["goals"] = goals;
  ready_ = ask(hello, "ready", command.start_s);
}

std::string Connection::end_in_words() {
  return child_ ? child_->end_in_words() : std::string();
}

Json Connection::ask(const Json& message, const char* expected, double within_s) {
  const Clock::time_point deadline = in(within_s);
  const auto what = [&] {
    return "an answer to \"" + message["type"].get<std::string>() + "\"";
  };
  std::optional<std::string> text;
  try {
    channel_->send(to_text(message), deadline);
    text = channel_->receive(deadline);
  } catch (const core::InputError&) {
    // A program that has ended is the better reason.
    const std::string end = end_in_words();
    if (!end.empty()) throw core::InputError::expected(name_, what(), "that it " + end);
    if (Clock::now() >= deadline) {
      std::array<char, 32> limit{};
      std::snprintf(limit.data(), limit.size(), "%g s", within_s);
      throw core::InputError::expected(name_, what() + " within " + limit.data(), "none");
    }
    throw;
  }
  if (!text) {
    const std::string end = end_in_words();
    throw core::InputError::expected(name_, what(),
                                     end.empty() ? "the end of its output" : "that it " + end);
  }
  Json answer = parse_message(*text, name_);
  const Fields fields(answer, name_);
  const std::string type = fields.text("type");
  if (type == "error") {
    throw core::InputError(name_ + ": " + fields.text("message").substr(0, kLongestMessage));
  }
  if (type != expected) fields.fail("type", "\"" + std::string(expected) + "\"");
  return answer;
}

}  // namespace segsim::peers::internal
