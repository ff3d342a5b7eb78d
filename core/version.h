#pragma once

namespace segsim::core {

/// Program version, for example "0.1.0 (3f2c1ab)"; the commit is that of the last configure.
[[nodiscard]] const char* version();

}  // namespace segsim::core
