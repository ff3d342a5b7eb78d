#include <algorithm>
#include <map>

#include "perception/checkpoint/weights_file.h"

namespace segsim::perception {

std::string shape_text(const std::vector<std::int64_t>& shape) {
  std::string text = "[";
  for (const std::int64_t side : shape) {
    text += (text.size() > 1 ? ", " : "") + std::to_string(side);
  }
  return text + "]";
}

std::string list_some(const std::string& what, const std::vector<std::string>& names) {
  if (names.empty()) return "";
  std::string text = what + " ";
  for (std::size_t i = 0; i < names.size() && i < 3; ++i)
    text += (i == 0 ? "" : ", ") + names[i];
  if (names.size() > 3) text += " and " + std::to_string(names.size() - 3) + " more";
  return text + "; ";
}

std::string describe_difference(const std::vector<NamedTensor>& found,
                                const std::vector<NamedTensor>& wanted) {
  std::map<std::string, const NamedTensor*> by_name;
  std::vector<std::string> missing, extra, reshaped;
  for (const NamedTensor& tensor : found) {
    if (!by_name.emplace(tensor.name, &tensor).second)
      extra.push_back(tensor.name + " (again)");
  }
  for (const NamedTensor& tensor : wanted) {
    const auto match = by_name.find(tensor.name);
    if (match == by_name.end()) {
      missing.push_back(tensor.name);
      continue;
    }
    if (match->second->shape != tensor.shape) {
      reshaped.push_back(tensor.name + " " + shape_text(match->second->shape) +
                         " instead of " + shape_text(tensor.shape));
    }
    by_name.erase(match);
  }
  for (const auto& [name, tensor] : by_name) extra.push_back(name);
  std::string text = list_some("missing", missing) + list_some("unknown", extra) +
                     list_some("shape of", reshaped);
  if (!text.empty()) text.resize(text.size() - 2);
  return text;
}

}  // namespace segsim::perception
