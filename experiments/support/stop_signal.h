#pragma once

/// @file
/// A clean end on SIGINT and SIGTERM, for commands that run long.

namespace segsim::experiments::support {

/// Turns both signals into a request while it lives; the second one ends the process at once.
/// One at a time.
class StopOnSignal {
 public:
  StopOnSignal();
  ~StopOnSignal();
  StopOnSignal(const StopOnSignal&) = delete;
  StopOnSignal& operator=(const StopOnSignal&) = delete;

  /// Since the last one was made.
  [[nodiscard]] static bool requested();
  /// As a signal would.
  static void request();

 private:
  void (*old_interrupt_)(int) = nullptr;
  void (*old_terminate_)(int) = nullptr;
};

}  // namespace segsim::experiments::support
