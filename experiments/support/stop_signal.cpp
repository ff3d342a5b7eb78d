#include "experiments/support/stop_signal.h"

#include <unistd.h>

#include <atomic>
#include <csignal>

#include "core/interrupted.h"

namespace segsim::experiments::support {
namespace {

std::atomic<bool> stop_requested{false};
static_assert(std::atomic<bool>::is_always_lock_free, "set from a signal handler");

void request_stop(int signal_number) {
  stop_requested = true;
  std::signal(signal_number, SIG_DFL);  // The second signal ends the process at once.
  static constexpr char kSaid[] = "\nsegsim: stopping (a second signal ends it at once)\n";
  [[maybe_unused]] const ssize_t written = ::write(STDERR_FILENO, kSaid, sizeof kSaid - 1);
}

}  // namespace

StopOnSignal::StopOnSignal() {
  stop_requested = false;
  old_interrupt_ = std::signal(SIGINT, request_stop);
  old_terminate_ = std::signal(SIGTERM, request_stop);
}

StopOnSignal::~StopOnSignal() {
  std::signal(SIGINT, old_interrupt_);
  std::signal(SIGTERM, old_terminate_);
  stop_requested = false;
}

bool StopOnSignal::requested() { return stop_requested; }

void StopOnSignal::check(const std::string& kept) {
  if (requested()) throw core::Interrupted("stopped by a signal; " + kept);
}

void StopOnSignal::request() { stop_requested = true; }

}  // namespace segsim::experiments::support
