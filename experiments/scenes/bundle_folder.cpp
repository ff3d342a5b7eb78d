#include "experiments/scenes/bundle_folder.h"

#include <unistd.h>

#include <string>

namespace segsim::experiments::scenes {

namespace fs = std::filesystem;

void write_bundle_folder(const fs::path& folder,
                         const std::function<void(const fs::path&)>& fill) {
  const fs::path temporary = folder.string() + ".tmp" + std::to_string(::getpid());
  fs::remove_all(temporary);
  fs::create_directories(temporary);
  try {
    fill(temporary);
    fs::remove_all(folder);
    fs::rename(temporary, folder);
  } catch (...) {
    fs::remove_all(temporary);
    throw;
  }
}

}  // namespace segsim::experiments::scenes
