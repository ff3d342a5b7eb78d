#include "nav/policies/policy_registry.h"

#include <algorithm>

#include "core/check.h"
#include "nav/policies/built_in_policies.h"

namespace segsim::nav {

PolicyRegistry::PolicyRegistry() { add_built_in_policies(*this); }

PolicyRegistry& PolicyRegistry::instance() {
  static PolicyRegistry registry;
  return registry;
}

void PolicyRegistry::add(const std::string& name, MakePolicy make) {
  add_entry({name, {}, [name, make = std::move(make)](const SettingsNode*) {
               return PolicyChoice(name, {}, make);
             }});
}

void PolicyRegistry::add_entry(Entry entry) {
  SEGSIM_CHECK(!entry.name.empty() && find(entry.name) == nullptr, "name of a policy");
  names_.push_back(entry.name);
  entries_.push_back(std::move(entry));
}

const PolicyRegistry::Entry* PolicyRegistry::find(const std::string& name) const {
  const auto found = std::find_if(entries_.begin(), entries_.end(),
                                  [&](const Entry& entry) { return entry.name == name; });
  return found == entries_.end() ? nullptr : &*found;
}

PolicyChoice PolicyRegistry::usual(const std::string& name) const {
  const Entry* entry = find(name);
  SEGSIM_CHECK(entry != nullptr && entry->required.empty(), name);
  return entry->choose(nullptr);
}

PolicyChoice PolicyRegistry::read(const core::ConfigNode& node,
                                  const ExpandPath& expand) const {
  if (const auto map = core::python_peer_map(node)) return read(*map, expand);
  const bool only_name = node.is_scalar();
  const core::ConfigNode type = only_name ? node : node.child("type");
  const Entry& entry = entries_[core::one_of(type, type.as_text(), names_)];
  if (only_name) {
    if (!entry.required.empty()) {
      node.fail("{type: " + entry.name + ", " + entry.required + "}",
                "\"" + entry.name + "\" alone");
    }
    return entry.choose(nullptr);
  }
  const SettingsNode settings(node, expand);
  PolicyChoice choice = entry.choose(&settings);
  node.finish();
  return choice;
}

}  // namespace segsim::nav
