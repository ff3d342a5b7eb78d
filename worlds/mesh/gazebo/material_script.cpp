#include "worlds/mesh/gazebo/internal/material_script.h"

#include <cctype>
#include <charconv>
#include <vector>

#include "core/file_io.h"

namespace segsim::worlds::internal {
namespace {

/// One line of a script, or a brace.
using Words = std::vector<std::string>;

/// The lines of a script as words, without comments; every brace is a line of its own.
std::vector<Words> lines_of(const std::string& text) {
  std::vector<Words> lines(1);
  std::string word;
  const auto end_word = [&] {
    if (!word.empty()) lines.back().push_back(std::move(word));
    word.clear();
  };
  const auto end_line = [&] {
    end_word();
    if (!lines.back().empty()) lines.emplace_back();
  };
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text.compare(i, 2, "//") == 0) {
      i = std::min(text.find('\n', i), text.size());
      end_line();
    } else if (text.compare(i, 2, "/*") == 0) {
      const std::size_t end = text.find("*/", i);
      i = end == std::string::npos ? text.size() : end + 1;
    } else if (text[i] == '{' || text[i] == '}') {
      end_line();
      lines.back().emplace_back(1, text[i]);
      end_line();
    } else if (text[i] == '\n') {
      end_line();
    } else if (std::isspace(static_cast<unsigned char>(text[i])) != 0) {
      end_word();
    } else {
      word += text[i];
    }
  }
  end_line();
  lines.pop_back();  // The line that end_line() has begun.
  return lines;
}

std::optional<glm::vec3> colour(const Words& line) {
  if (line.size() < 4) return std::nullopt;
  glm::vec3 rgb;
  for (int i = 0; i < 3; ++i) {
    const std::string& word = line[static_cast<std::size_t>(i) + 1U];
    if (std::from_chars(word.data(), word.data() + word.size(), rgb[i]).ec != std::errc()) {
      return std::nullopt;
    }
  }
  return rgb;
}

/// Name behind "material"; "a : b" and "a:b" name the parent, too.
struct Title {
  std::string name, parent;
};

Title title_of(const Words& line) {
  std::string text;
  for (std::size_t i = 1; i < line.size(); ++i) text += line[i];
  const std::size_t colon = text.find(':');
  if (colon == std::string::npos) return {text, {}};
  return {text.substr(0, colon), text.substr(colon + 1)};
}

/// Takes over what one line inside a pass or a texture_unit says.
void apply(const Words& line, ScriptedMaterial& material, bool& has_texture) {
  const std::string& key = line.front();
  if (key == "diffuse") {
    if (const auto rgb = colour(line)) material.diffuse = rgb;
  } else if (key == "emissive") {
    if (const auto rgb = colour(line)) material.emissive = rgb;
  } else if (key == "texture" && line.size() > 1 && !has_texture) {
    material.texture = line[1];
    has_texture = true;
  }
}

}  // namespace

void MaterialScripts::add_file(const std::filesystem::path& file) {
  if (!files_.insert(file).second) return;
  int depth = 0;
  int techniques = 0;
  bool has_texture = false;
  ScriptedMaterial* material = nullptr;
  for (const Words& line : lines_of(core::read_file(file))) {
    const std::string& key = line.front();
    if (key == "{") {
      ++depth;
    } else if (key == "}") {
      if (--depth == 0) material = nullptr;
    } else if (depth == 0) {
      material = nullptr;
      if (key != "material") continue;
      const Title title = title_of(line);
      ScriptedMaterial fresh;
      if (const ScriptedMaterial* parent = find(title.parent)) fresh = *parent;
      fresh.folder = file.parent_path();
      techniques = 0;
      has_texture = false;
      material = &(materials_[title.name] = fresh);
    } else if (material != nullptr) {
      if (key == "technique") ++techniques;
      if (techniques == 1) apply(line, *material, has_texture);
    }
  }
}

const ScriptedMaterial* MaterialScripts::find(const std::string& name) const {
  const auto known = materials_.find(name);
  return known == materials_.end() ? nullptr : &known->second;
}

}  // namespace segsim::worlds::internal
