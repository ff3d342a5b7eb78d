#include <ostream>

#include "core/config.h"
#include "core/file_io.h"
#include "reconstruction/datasets/labels_file.h"
#include "reconstruction/datasets/mask_files.h"

namespace segsim::reconstruction {
namespace {

using core::ConfigNode;

std::string quoted(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') result += '\\';
    result += c == '\n' ? ' ' : c;
  }
  return result + "\"";
}

void write_numbers(std::ostream& out, const char* key,
                   const std::vector<std::pair<std::string, double>>& numbers) {
  if (numbers.empty()) return;
  out << key << ":\n";
  for (const auto& [name, value] : numbers) out << "  " << name << ": " << value << '\n';
}

std::vector<std::pair<std::string, double>> read_numbers(const ConfigNode& root,
                                                         const char* key) {
  std::vector<std::pair<std::string, double>> numbers;
  const auto node = root.optional_child(key);
  if (!node) return numbers;
  for (const std::string& name : node->keys()) {
    numbers.emplace_back(name, node->number(name));
  }
  return numbers;
}

}  // namespace

void write_mask_set_info(const std::filesystem::path& folder, const MaskSetInfo& info) {
  core::write_file_atomically(folder / "masks.yaml", [&](std::ostream& out) {
    out.precision(6);
    out << "schema: segsim.masks\nversion: 1\nsource: " << quoted(info.source)
        << "\nclasses:\n";
    for (const core::SceneClass& c : info.classes) {
      out << "  - {id: " << c.id << ", name: " << quoted(c.name)
          << ", thing: " << (c.thing ? "true" : "false") << "}\n";
    }
    if (!info.prompts.empty()) out << "prompts:\n";
    for (const std::string& prompt : info.prompts) out << "  - " << quoted(prompt) << '\n';
    write_numbers(out, "settings", info.settings);
    write_numbers(out, "measured", info.measured);
  });
}

MaskSetInfo read_mask_set_info(const std::filesystem::path& file) {
  const ConfigNode root = ConfigNode::load(file);
  expect_schema(root, "segsim.masks", 1);
  MaskSetInfo info;
  info.source = root.text_or("source", "");
  info.classes = read_scene_classes(root);
  if (info.classes.empty()) root.fail("a list of classes", "none");
  if (root.has("prompts")) info.prompts = root.texts("prompts");
  info.settings = read_numbers(root, "settings");
  info.measured = read_numbers(root, "measured");
  root.finish();
  return info;
}

}  // namespace segsim::reconstruction
