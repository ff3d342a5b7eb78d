#include "core/process/temporary_folder.h"

#include <cstdlib>  // mkdtemp
#include <system_error>

#include "core/error.h"

namespace segsim::core {

namespace fs = std::filesystem;

TemporaryFolder::TemporaryFolder(const std::string& prefix) {
  std::string name = (fs::temp_directory_path() / (prefix + "_XXXXXX")).string();
  if (::mkdtemp(name.data()) == nullptr) {
    throw InputError::expected(name, "a place for temporary files", "none");
  }
  path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

}  // namespace segsim::core
