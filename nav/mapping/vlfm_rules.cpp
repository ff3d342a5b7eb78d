#include "nav/mapping/vlfm_rules.h"

#include <algorithm>

namespace segsim::nav {

const std::vector<std::string>& quirk_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> list;
    for (std::size_t k = 1; k <= kQuirks; ++k) list.push_back("Q" + std::to_string(k));
    return list;
  }();
  return names;
}

std::string VlfmRules::text() const {
  const auto count = std::count(rules_.begin(), rules_.end(), Rule::kVlfm);
  if (count == 0) return "fixed";
  if (count == static_cast<std::ptrdiff_t>(kQuirks)) return "vlfm";
  std::string text = "fixed, vlfm:";
  for (std::size_t k = 0; k < kQuirks; ++k) {
    if (rules_[k] == Rule::kVlfm) text += " " + quirk_names()[k];
  }
  return text;
}

}  // namespace segsim::nav
