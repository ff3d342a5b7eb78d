#include "experiments/suites/layered_yaml.h"

#include <algorithm>
#include <cctype>

#include "core/check.h"

namespace segsim::experiments::suites {
namespace {

using core::ConfigNode;

/// Safe without quotes, also between brackets: names, paths, numbers.
bool is_plain(const std::string& text) {
  if (text.empty() || text == "-" || text == "~") return false;
  std::string lower = text;
  for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  if (lower == "null") return false;
  return std::all_of(text.begin(), text.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
           std::string("_./+-").find(c) != std::string::npos;
  });
}

/// The layers that count: from the last one that is no map on.
std::vector<ConfigNode> maps_on_top(const std::vector<ConfigNode>& layers) {
  std::vector<ConfigNode> maps;
  for (const ConfigNode& layer : layers) {
    if (layer.is_map()) {
      maps.push_back(layer);
    } else {
      maps.clear();
    }
  }
  return maps;
}

using Entries = std::vector<std::pair<std::string, std::string>>;

std::string flow_map(const std::vector<ConfigNode>& maps, const Entries& first) {
  Entries entries;
  for (const auto& [key, text] : first) entries.emplace_back(key, yaml_scalar(text));
  const auto has = [&](const std::string& key) {
    return std::any_of(entries.begin(), entries.end(),
                       [&](const auto& entry) { return entry.first == key; });
  };
  for (const ConfigNode& map : maps) {
    for (const std::string& key : map.keys()) {
      if (has(key)) continue;
      std::vector<ConfigNode> children;
      for (const ConfigNode& layer : maps) {
        if (layer.has(key)) children.push_back(layer.child(key));
      }
      if (!children.empty()) entries.emplace_back(key, flow_yaml(children));
    }
  }
  std::string text;
  for (const auto& [key, value] : entries) {
    if (!text.empty()) text += ", ";
    text.append(key).append(": ").append(value);
  }
  return "{" + text + "}";
}

}  // namespace

std::string yaml_scalar(const std::string& text) {
  if (is_plain(text)) return text;
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') quoted += '\\';
    if (c == '\n') {
      quoted += "\\n";
    } else {
      quoted += c;
    }
  }
  return quoted + "\"";
}

std::string flow_yaml(const std::vector<ConfigNode>& layers, const Entries& first) {
  SEGSIM_CHECK(!layers.empty(), "something to write");
  const ConfigNode& top = layers.back();
  if (top.is_scalar()) return yaml_scalar(top.as_text());
  if (top.is_map()) return flow_map(maps_on_top(layers), first);
  std::string text;
  for (const ConfigNode& element : top.as_list()) {
    text += (text.empty() ? "" : ", ") + flow_yaml({element});
  }
  return "[" + text + "]";
}

}  // namespace segsim::experiments::suites
