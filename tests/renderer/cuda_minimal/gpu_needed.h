#pragma once

#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace segsim::renderer {

/// What a check returns on a machine whose GPU cannot be used: 2, which callers take for
/// "nothing was checked", or 1, a failure, where the environment variable SEGSIM_REQUIRE_GPU
/// demands one (set, and neither empty nor 0).
/// @param what  Why not, for standard error.
[[nodiscard]] inline int exit_code_without_gpu(const char* program, const char* what) {
  const char* required = std::getenv("SEGSIM_REQUIRE_GPU");
  const bool fails =
      required != nullptr && *required != '\0' && std::strcmp(required, "0") != 0;
  std::fprintf(stderr, "%s: nothing checked: %s%s\n", program, what,
               fails ? ", and SEGSIM_REQUIRE_GPU demands a GPU" : "");
  return fails ? 1 : 2;
}

}  // namespace segsim::renderer
