#include <sstream>
#include <string_view>

#include "core/file_io.h"
#include "worlds/mesh/gazebo/internal/visual_materials.h"
#include "worlds/mesh/internal/mesh_parts.h"

namespace segsim::worlds::internal {
namespace {

namespace fs = std::filesystem;

/// What stands between the first `open` and the `close` behind it; taken off `text` with all
/// before it. Empty when there is none.
std::string_view take_between(std::string_view& text, std::string_view open,
                              std::string_view close) {
  const std::size_t begin = text.find(open);
  const std::size_t end =
      begin == std::string_view::npos ? begin : text.find(close, begin + open.size());
  if (end == std::string_view::npos) {
    text = {};
    return {};
  }
  const std::string_view inside = text.substr(begin + open.size(), end - begin - open.size());
  text.remove_prefix(end + close.size());
  return inside;
}

/// "a b.png" of "a%20b.png".
std::string without_escapes(std::string_view text) {
  std::string plain;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text.substr(i).starts_with("%20")) {
      plain += ' ';
      i += 2;
    } else {
      plain += text[i];
    }
  }
  return plain;
}

std::vector<std::string> collada_textures(std::string_view text) {
  std::vector<std::string> names;
  std::string_view images = take_between(text, "<library_images>", "</library_images>");
  while (!images.empty()) {
    const std::string_view name = take_between(images, "<init_from>", "</init_from>");
    if (!name.empty()) names.push_back(without_escapes(name));
  }
  return names;
}

/// The rest of a line behind its first word, without blanks around it.
std::string argument_of(const std::string& line, const std::string& key) {
  std::istringstream words(line);
  std::string word;
  if (!(words >> word) || word != key) return {};
  std::string rest;
  std::getline(words >> std::ws, rest);
  while (!rest.empty() && (rest.back() == '\r' || rest.back() == ' ')) rest.pop_back();
  return rest;
}

std::vector<std::string> obj_textures(const std::string& text, const fs::path& folder) {
  std::vector<std::string> names;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const std::string library = argument_of(line, "mtllib");
    if (library.empty()) continue;
    if (!fs::is_regular_file(folder / library)) {
      names.push_back(library);
      continue;
    }
    std::istringstream materials(core::read_file(folder / library));
    for (std::string entry; std::getline(materials, entry);) {
      if (std::string name = argument_of(entry, "map_Kd"); !name.empty()) {
        names.push_back(std::move(name));
      }
    }
  }
  return names;
}

}  // namespace

std::vector<std::string> texture_names(const fs::path& mesh_file) {
  const std::string extension = lower_case_extension(mesh_file);
  if (extension == ".dae") return collada_textures(core::read_file(mesh_file));
  if (extension == ".obj") {
    return obj_textures(core::read_file(mesh_file), mesh_file.parent_path());
  }
  return {};
}

}  // namespace segsim::worlds::internal
