#pragma once

#include "core/error.h"

namespace segsim::renderer {

/// The GPU cannot do what was asked: none there, driver too old, memory full, device lost, or
/// an option that only the CPU renderer has. The message says which.
class GpuError : public core::InputError {
 public:
  using core::InputError::InputError;
};

}  // namespace segsim::renderer
