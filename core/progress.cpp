#include "core/progress.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

namespace segsim::core {
namespace {

thread_local std::string prefix;

}  // namespace

ProgressPrefix::ProgressPrefix(std::string words)
    : before_(std::exchange(prefix, std::move(words))) {}

ProgressPrefix::~ProgressPrefix() { prefix = before_; }

std::string format_duration(double duration_s) {
  const auto total = static_cast<long>(std::lround(std::max(0.0, duration_s)));
  char text[48];
  if (total >= 3600) {
    std::snprintf(text, sizeof text, "%ld:%02ld:%02ld", total / 3600, total / 60 % 60,
                  total % 60);
  } else if (total >= 60) {
    std::snprintf(text, sizeof text, "%ld:%02ld", total / 60, total % 60);
  } else {
    std::snprintf(text, sizeof text, "%ld s", total);
  }
  return text;
}

Progress::Progress(const std::string& label, std::int64_t total)
    : label_(prefix + label),
      total_(std::max<std::int64_t>(total, 1)),
      terminal_(::isatty(STDERR_FILENO) == 1),
      start_(Clock::now()),
      last_print_(start_) {}

Progress::~Progress() { finish(); }

void Progress::update(std::int64_t done, const std::string& note) {
  if (first_done_ < 0) first_done_ = std::max<std::int64_t>(0, done - 1);
  done_ = done;
  note_ = note;
  const Clock::time_point now = Clock::now();
  const auto interval = terminal_ ? std::chrono::milliseconds(100) : std::chrono::seconds(10);
  if (now - last_print_ < interval) return;
  last_print_ = now;
  print(now);
}

void Progress::finish() {
  if (finished_) return;
  finished_ = true;
  print(Clock::now());
  if (terminal_) std::fputc('\n', stderr);
}

void Progress::print(Clock::time_point now) {
  const double elapsed_s = std::chrono::duration<double>(now - start_).count();
  const std::int64_t fresh = done_ - std::max<std::int64_t>(0, first_done_);
  const double left_s =
      fresh > 0 ? elapsed_s / static_cast<double>(fresh) * static_cast<double>(total_ - done_)
                : 0;
  const int filled = static_cast<int>(20 * std::min(done_, total_) / total_);
  std::string bar(static_cast<std::size_t>(filled), '#');
  bar.resize(20, '.');
  const std::string time = done_ >= total_ ? "in " + format_duration(elapsed_s)
                           : fresh > 0     ? "ETA " + format_duration(left_s)
                                           : "starting";
  std::fprintf(stderr, "%s%s [%s] %lld/%lld %s %s%s", terminal_ ? "\r" : "", label_.c_str(),
               bar.c_str(), static_cast<long long>(done_), static_cast<long long>(total_),
               time.c_str(), note_.c_str(), terminal_ ? "\033[K" : "\n");
  std::fflush(stderr);
}

}  // namespace segsim::core
