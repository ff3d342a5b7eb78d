#include "experiments/support/shipped_file.h"

namespace segsim::experiments::support {

std::filesystem::path find_shipped(const std::filesystem::path& file) {
  namespace fs = std::filesystem;
  std::error_code error;
  if (file.empty() || file.is_absolute() || fs::exists(file, error)) return file;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  if (error) return file;
  const fs::path shipped = program.parent_path().parent_path() / "share" / "segsim" / file;
  return fs::exists(shipped, error) ? shipped : file;
}

}  // namespace segsim::experiments::support
