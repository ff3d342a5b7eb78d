#include <algorithm>
#include <array>

#include "worlds/mesh/gazebo/internal/missing_files.h"

namespace segsim::worlds::internal {
namespace {

constexpr auto kKindNames =
    std::to_array<const char*>({"model", "mesh", "material", "texture", "texture"});

}  // namespace

void MissingFiles::add(MissingKind kind, const std::string& uri, const std::string& user) {
  const auto known = std::find_if(files_.begin(), files_.end(), [&](const MissingFile& file) {
    return file.kind == kind && file.uri == uri;
  });
  if (known != files_.end()) {
    ++known->count;
  } else {
    files_.push_back({kind, uri, user, 1});
  }
}

bool MissingFiles::has(MissingKind kind) const {
  return std::any_of(files_.begin(), files_.end(),
                     [&](const MissingFile& file) { return file.kind == kind; });
}

std::string MissingFiles::text(const MissingFile& file) {
  std::string text = std::string(kKindNames[static_cast<std::size_t>(file.kind)]) + " " +
                     file.uri + " (" + file.user;
  if (file.count > 1) text += " and " + std::to_string(file.count - 1) + " more";
  return text + ")";
}

std::string MissingFiles::text() const {
  std::string text;
  for (const MissingFile& file : files_) {
    text += (text.empty() ? "" : ", ") + MissingFiles::text(file);
  }
  return text;
}

}  // namespace segsim::worlds::internal
