#include "perception/data/class_map.h"

#include <cctype>

#include "core/config.h"

namespace segsim::perception {
namespace {

using core::ConfigNode;

void add_entry(ClassMap& map, const ConfigNode& node, const std::string& target) {
  const std::string name = normalised_name(node.as_text());
  if (name.empty()) node.fail("a name", "nothing");
  const auto [entry, added] = map.target_of.emplace(name, target);
  if (!added && entry->second != target) {
    node.fail("a name with one target", "'" + name + "' of '" + entry->second + "' again");
  }
}

/// The longest entry that is the whole phrase or its end after a blank.
const std::string* longest_end(const std::map<std::string, std::string>& entries,
                               const std::string& phrase) {
  for (std::size_t start = 0; start != std::string::npos;) {
    const auto found = entries.find(phrase.substr(start));
    if (found != entries.end()) return &found->second;
    const std::size_t blank = phrase.find(' ', start);
    start = blank == std::string::npos ? blank : blank + 1;
  }
  return nullptr;
}

}  // namespace

std::string normalised_name(const std::string& name) {
  std::string result;
  for (const char c : name) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '_' || c == '-' || std::isspace(byte) != 0) {
      if (!result.empty() && result.back() != ' ') result += ' ';
    } else {
      result += static_cast<char>(std::tolower(byte));
    }
  }
  if (!result.empty() && result.back() == ' ') result.pop_back();
  return result;
}

std::optional<std::string> ClassMap::find(const std::string& name) const {
  const std::string phrase = normalised_name(name);
  if (const auto exact = target_of.find(phrase); exact != target_of.end()) {
    return exact->second;
  }
  if (!free_text) return std::nullopt;
  const std::string* target = longest_end(target_of, phrase);
  if (target == nullptr && phrase.size() > 1 && phrase.back() == 's') {
    target = longest_end(target_of, phrase.substr(0, phrase.size() - 1));
  }
  return target == nullptr ? std::nullopt : std::optional<std::string>(*target);
}

ClassMap read_class_map(const std::filesystem::path& file) {
  const ConfigNode root = ConfigNode::load(file);
  if (root.text("schema") != "segsim.class_map") {
    root.child("schema").fail("segsim.class_map", root.text("schema"));
  }
  if (root.integer("version") != 1) {
    root.child("version").fail("1", std::to_string(root.integer("version")));
  }
  ClassMap map;
  map.title = root.text_or("title", "");
  map.free_text = root.boolean_or("free_text", false);
  const ConfigNode classes = root.child("classes");
  if (!classes.is_map() || classes.keys().empty()) {
    classes.fail("class names with lists of names", "none");
  }
  for (const std::string& target : classes.keys()) {
    for (const ConfigNode& name : classes.list(target)) add_entry(map, name, target);
  }
  // A class is its own name too, unless the file says otherwise.
  for (const std::string& target : classes.keys()) {
    map.target_of.emplace(normalised_name(target), target);
  }
  for (const ConfigNode& name : root.list("leave_out")) add_entry(map, name, "");
  root.finish();
  return map;
}

}  // namespace segsim::perception
