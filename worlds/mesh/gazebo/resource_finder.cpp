#include <algorithm>
#include <array>
#include <cstdlib>
#include <sstream>
#include <string_view>

#include "core/error.h"
#include "worlds/mesh/gazebo/internal/resource_finder.h"

namespace segsim::worlds::internal {
namespace {

namespace fs = std::filesystem;

constexpr auto kPathVariables =
    std::to_array<const char*>({"GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH",
                                "GAZEBO_MODEL_PATH", "GAZEBO_RESOURCE_PATH"});
constexpr int kFoldersAboveWorld = 3;

std::optional<fs::path> if_exists(const fs::path& path) {
  std::error_code error;
  if (path.empty() || !fs::exists(path, error)) return std::nullopt;
  return path;
}

/// "b/c" of "a/b/c"; empty if there is no slash.
fs::path without_first(const fs::path& path) {
  fs::path rest;
  for (auto part = path.begin(); part != path.end(); ++part) {
    if (part != path.begin()) rest /= *part;
  }
  return rest;
}

/// The folder with the model.config that a file of a model lies below; empty if there is none.
fs::path model_folder(fs::path folder) {
  for (int level = 0; level < 4 && !folder.empty(); ++level) {
    std::error_code error;
    if (fs::exists(folder / "model.config", error)) return folder;
    folder = folder.parent_path();
  }
  return {};
}

}  // namespace

ResourceFinder::ResourceFinder(const fs::path& world_file,
                               const std::vector<fs::path>& named_folders) {
  for (const fs::path& folder : named_folders) {
    if (!fs::is_directory(folder)) {
      throw core::InputError::expected("resource path " + folder.string(), "a folder", "none");
    }
    add_with_models(fs::absolute(folder));
  }
  for (const char* variable : kPathVariables) {
    const char* value = std::getenv(variable);
    std::istringstream paths(value == nullptr ? "" : value);
    for (std::string path; std::getline(paths, path, ':');) {
      if (!path.empty()) folders_.emplace_back(path);
    }
  }
  fs::path folder = fs::absolute(world_file).lexically_normal().parent_path();
  for (int level = 0; level <= kFoldersAboveWorld && folder.has_relative_path(); ++level) {
    add_with_models(folder);
    folder = folder.parent_path();
  }
}

void ResourceFinder::add_with_models(const fs::path& folder) {
  folders_.push_back(folder);
  std::vector<fs::path> models;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    if (entry.is_directory(error) && entry.path().filename().string().ends_with("models")) {
      models.push_back(entry.path());
    }
  }
  std::sort(models.begin(), models.end());
  folders_.insert(folders_.end(), models.begin(), models.end());
}

std::optional<fs::path> ResourceFinder::below_folders(const fs::path& path) const {
  if (path.empty()) return std::nullopt;
  for (const fs::path& folder : folders_) {
    if (auto found = if_exists(folder / path)) return found;
  }
  return std::nullopt;
}

std::optional<fs::path> ResourceFinder::find_on_fuel(const std::string& uri) const {
  static constexpr std::string_view kModels = "/models/";
  const std::size_t at = uri.find(kModels);
  if (at == std::string::npos) return std::nullopt;
  const fs::path name = uri.substr(at + kModels.size());
  if (auto found = below_folders(name)) return found;
  // https://<server>/1.0/<owner>/models/<name> is downloaded to
  // <server>/<owner>/models/<name>, in lower case, with one folder for each version.
  const char* home = std::getenv("HOME");
  if (home == nullptr) return std::nullopt;
  std::string place = uri.substr(uri.find("://") + 3);
  if (const std::size_t version = place.find("/1.0/"); version != std::string::npos) {
    place.erase(version, 4);
  }
  std::transform(place.begin(), place.end(), place.begin(), [](char c) {
    return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  });
  std::optional<fs::path> newest;
  for (const char* cache : {".gz/fuel", ".ignition/fuel"}) {
    std::error_code error;
    for (const fs::directory_entry& version :
         fs::directory_iterator(fs::path(home) / cache / place, error)) {
      if (!newest || version.path() > *newest) newest = version.path();
    }
    if (newest) return newest;
  }
  return std::nullopt;
}

std::optional<fs::path> ResourceFinder::find(const std::string& uri,
                                             const fs::path& from_folder) const {
  if (uri.empty()) return std::nullopt;
  if (uri.starts_with("http://") || uri.starts_with("https://")) return find_on_fuel(uri);
  const std::size_t scheme_end = uri.find("://");
  const std::string scheme =
      scheme_end == std::string::npos ? std::string() : uri.substr(0, scheme_end);
  const fs::path path = scheme.empty() ? uri : uri.substr(scheme_end + 3);
  if (path.is_absolute()) return if_exists(path);
  if (scheme.empty() && !from_folder.empty()) {
    if (auto found = if_exists(from_folder / path)) return found;
  }
  if (auto found = below_folders(path)) return found;
  const fs::path rest = scheme == "file" ? path : without_first(path);
  if (const fs::path model = model_folder(from_folder); !model.empty() && !rest.empty()) {
    if (auto found = if_exists(model / rest)) return found;
  }
  if (scheme == "model" || scheme == "package") return below_folders(rest);
  return std::nullopt;
}

}  // namespace segsim::worlds::internal
