#pragma once

#include <chrono>
#include <cstdint>
#include <string>

namespace segsim::core {

/// A progress line with an estimate of the time left, on standard error: redrawn in place on a
/// terminal, printed every ten seconds elsewhere (logs, CI).
class Progress {
 public:
  Progress(const std::string& label, std::int64_t total);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// @param done  Units finished so far, in [0, total].  @param note  Shown behind the bar.
  void update(std::int64_t done, const std::string& note = {});
  /// Prints the last line once and ends it.
  void finish();

 private:
  using Clock = std::chrono::steady_clock;
  void print(Clock::time_point now);

  std::string label_, note_;
  std::int64_t total_, done_ = 0, first_done_ = -1;
  bool terminal_, finished_ = false;
  Clock::time_point start_, last_print_;
};

/// Words before the labels of all progress lines that the calling thread begins while it
/// lives, so that lines of work that runs side by side can be told apart.
class ProgressPrefix {
 public:
  explicit ProgressPrefix(std::string words);
  ~ProgressPrefix();
  ProgressPrefix(const ProgressPrefix&) = delete;
  ProgressPrefix& operator=(const ProgressPrefix&) = delete;

 private:
  std::string before_;
};

/// "1:02:03", "4:05" or "6 s".
[[nodiscard]] std::string format_duration(double duration_s);

}  // namespace segsim::core
