#pragma once

#include <ATen/autocast_mode.h>
#include <torch/version.h>

namespace segsim::perception {

/// Chooses float16 on CUDA for operations that bear it, while it lives.
class AutocastScope {
 public:
  explicit AutocastScope(bool on) : on_(on) {
    if (on_) set(true);
  }
  ~AutocastScope() {
    if (!on_) return;
    at::autocast::clear_cache();
    set(false);
  }
  AutocastScope(const AutocastScope&) = delete;
  AutocastScope& operator=(const AutocastScope&) = delete;

 private:
  static void set(bool on) {
#if TORCH_VERSION_MAJOR > 2 || (TORCH_VERSION_MAJOR == 2 && TORCH_VERSION_MINOR >= 4)
    at::autocast::set_autocast_enabled(at::kCUDA, on);
#else
    at::autocast::set_enabled(on);
#endif
  }
  bool on_;
};

}  // namespace segsim::perception
