#include "experiments/reproducibility/backend_warning.h"

#include <cstdio>
#include <mutex>

namespace segsim::experiments::reproducibility {

void warn_about_backend(const std::string& reason) {
  static std::once_flag said;
  std::call_once(said, [&] { std::fprintf(stderr, "segsim: warning: %s\n", reason.c_str()); });
}

}  // namespace segsim::experiments::reproducibility
