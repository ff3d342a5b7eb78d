#pragma once

namespace segsim::core {

/// Program version, for example "0.1.0 (3f2c1ab)"; the commit is that of the build, "-dirty"
/// with local changes.
[[nodiscard]] const char* version();

}  // namespace segsim::core
