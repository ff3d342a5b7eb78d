#pragma once

/// @file
/// Bytes that nobody can foresee, from the system: for names that no other process makes, here
/// or on another machine, and for secrets. What an experiment draws comes from core/random.h.

#include <string>

namespace segsim::core {

/// @return  Two lower-case hexadecimal digits for each byte.
[[nodiscard]] std::string random_hex(int bytes);

/// "3f9c0a417be25d86": for names of temporary files. A process id would be the same in two
/// containers, or on two machines, that share a folder.
[[nodiscard]] inline std::string unique_suffix() { return random_hex(8); }

}  // namespace segsim::core
