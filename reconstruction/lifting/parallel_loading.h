#pragma once

/// @file
/// Files read by several threads, with one thread's errors.

#include <exception>
#include <vector>

#include "renderer/scene/parallel.h"

namespace segsim::reconstruction::internal {

/// As parallel_for_each(), for bodies that may throw: all are called, then the error of the
/// smallest i is thrown, so that which file is named does not depend on the threads.
template <class Body>
void load_each(std::size_t count, const Body& body) {
  std::vector<std::exception_ptr> errors(count);
  renderer::internal::parallel_for_each(count, 1, [&](std::size_t i) {
    try {
      body(i);
    } catch (...) {
      errors[i] = std::current_exception();
    }
  });
  for (const std::exception_ptr& error : errors) {
    if (error) std::rethrow_exception(error);
  }
}

}  // namespace segsim::reconstruction::internal
