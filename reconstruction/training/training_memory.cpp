#include "reconstruction/training/training_memory.h"

#include <new>

#include <c10/util/Exception.h>

#include "core/error.h"

namespace segsim::reconstruction {
namespace {

/// libtorch has one type for all errors of its CPU allocator, and another for the GPU's.
bool is_about_memory(const c10::Error& error) {
  if (dynamic_cast<const c10::OutOfMemoryError*>(&error) != nullptr) return true;
  const std::string text = error.what_without_backtrace();
  for (const char* words : {"out of memory", "can't allocate memory", "not enough memory"}) {
    if (text.find(words) != std::string::npos) return true;
  }
  return false;
}

}  // namespace

void with_memory_errors(const std::string& place, const std::function<std::string()>& advice,
                        const std::function<void()>& action) {
  const auto full = [&](const char* whose) {
    return core::InputError::expected(place, "memory for it (" + advice() + ")",
                                      std::string(whose) + " full");
  };
  try {
    action();
  } catch (const std::bad_alloc&) {
    throw full("the host's");
  } catch (const c10::Error& error) {
    if (!is_about_memory(error)) throw;
    const bool on_gpu =
        std::string(error.what_without_backtrace()).find("CUDA") != std::string::npos;
    throw full(on_gpu ? "the GPU's" : "the host's");
  }
}

}  // namespace segsim::reconstruction
