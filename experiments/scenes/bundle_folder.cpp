#include "experiments/scenes/bundle_folder.h"

#include <string>

#include "core/system/sync_to_disk.h"
#include "core/system/system_random.h"

namespace segsim::experiments::scenes {

namespace fs = std::filesystem;

void write_bundle_folder(const fs::path& folder,
                         const std::function<void(const fs::path&)>& fill) {
  const fs::path temporary = folder.string() + ".tmp" + core::unique_suffix();
  fs::create_directories(temporary);
  try {
    fill(temporary);
    fs::remove_all(folder);
    fs::rename(temporary, folder);
    core::sync_to_disk(fs::absolute(folder).parent_path());
  } catch (...) {
    fs::remove_all(temporary);
    throw;
  }
}

}  // namespace segsim::experiments::scenes
