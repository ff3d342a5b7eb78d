#pragma once

/// @file
/// A clean end on SIGINT and SIGTERM, for commands that run long.

#include <string>

namespace segsim::experiments::support {

/// Turns both signals into a request while it lives; the second one ends the process at once.
/// One at a time. Work that is shared by several commands asks whether it is to stop; without
/// such an object it never is.
class StopOnSignal {
 public:
  StopOnSignal();
  ~StopOnSignal();
  StopOnSignal(const StopOnSignal&) = delete;
  StopOnSignal& operator=(const StopOnSignal&) = delete;

  /// Since the one that lives was made.
  [[nodiscard]] static bool requested();
  /// Between two pieces of work. @param kept  What the user can go on with.
  /// @throws core::Interrupted if it is requested.
  static void check(
      const std::string& kept = "what is done is kept, and the same command goes on");
  /// As a signal would.
  static void request();

 private:
  void (*old_interrupt_)(int) = nullptr;
  void (*old_terminate_)(int) = nullptr;
};

}  // namespace segsim::experiments::support
