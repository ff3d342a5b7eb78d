#include "experiments/scene_labels/label_operations.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <map>
#include <utility>

#include "core/error.h"
#include "reconstruction/lifting/lifting.h"

namespace segsim::experiments::scene_labels {
namespace {

using core::InputError;
using core::SceneInstance;

constexpr std::size_t kLongestName = 80;
/// Those that are no crumbs are not more, unless the instance is dust.
constexpr int kMostPieces = static_cast<int>(1.0 / kLeastPiece);

/// An instance that has surfels: its row, or what its surfels say if it has none.
struct Found {
  SceneInstance row;
  bool listed = false;
  std::vector<std::uint32_t> members;

  [[nodiscard]] const std::string& called() const { return row.name; }
};

Found find(const LabelState& state, std::uint16_t instance) {
  Found found;
  if (instance != 0) found.members = state.members(instance);
  if (found.members.empty()) {
    throw InputError::expected("instance " + std::to_string(instance),
                               "an instance that has surfels", "none");
  }
  if (const SceneInstance* row = state.find_instance(instance)) {
    found.row = *row;
    found.listed = true;
    return found;
  }
  std::map<std::uint16_t, std::size_t> votes;
  for (const std::uint32_t i : found.members) ++votes[state.class_ids()[i]];
  found.row.id = instance;
  found.row.class_id =
      std::max_element(votes.begin(), votes.end(), [](const auto& a, const auto& b) {
        return a.second < b.second;
      })->first;
  found.row.name = state.class_name(found.row.class_id) + " " + std::to_string(instance);
  return found;
}

/// Part 0 only exists as an object if its class is one that objects have.
void require_class(const LabelState& state, const Found& found) {
  for (const core::SceneClass& c : state.classes()) {
    if (c.id == found.row.class_id && c.thing) return;
  }
  throw InputError::expected(found.called(), "an instance of a class (name it first)", "none");
}

void check_name(const std::string& name, const char* what) {
  const bool bad = std::any_of(name.begin(), name.end(), [](char c) {
    return static_cast<unsigned char>(c) < 0x20 || c == 0x7f;
  });
  if (!name.empty() && name.size() <= kLongestName && !bad && name.front() != ' ' &&
      name.back() != ' ') {
    return;
  }
  throw InputError::expected(
      what, "one line of 1 to " + std::to_string(kLongestName) + " bytes without space around",
      "\"" + name.substr(0, kLongestName) + "\"");
}

/// The class of that name; a new one joins the edit.
core::SceneClass class_named(const LabelState& state, const NamedClass& wanted,
                             LabelEdit& edit) {
  if (const core::SceneClass* known = state.find_class(wanted.name)) return *known;
  check_name(wanted.name, "class");
  const bool upper = std::any_of(wanted.name.begin(), wanted.name.end(),
                                 [](char c) { return c >= 'A' && c <= 'Z'; });
  if (upper || wanted.name == "void") {
    throw InputError::expected("class", "a name in lower case other than void",
                               "\"" + wanted.name + "\"");
  }
  edit.new_classes = {{state.unused_class_id(), wanted.name, wanted.thing}};
  return edit.new_classes.front();
}

void set_all(const std::vector<std::uint32_t>& surfels, std::uint16_t class_id,
             std::uint16_t instance_id, LabelEdit& edit) {
  edit.labels.runs =
      label_runs(surfels, [&](std::size_t) { return std::pair(class_id, instance_id); });
}

/// Rows with the boxes of their surfels. @param instance_of  Of the k-th of the surfels.
template <class InstanceOf>
std::vector<SceneInstance> boxed(const renderer::SurfelCloud& surfels,
                                 const std::vector<std::uint32_t>& of,
                                 const InstanceOf& instance_of,
                                 const std::vector<SceneInstance>& rows) {
  renderer::SurfelCloud part;
  for (std::size_t k = 0; k < of.size(); ++k) {
    part.position_m.push_back(surfels.position_m[of[k]]);
    part.instance_id.push_back(instance_of(k));
  }
  return reconstruction::instance_boxes(part, rows);
}

/// @param part  Of every member; 0 keeps the number.
LabelEdit into_parts(const LabelState& state, const renderer::SurfelCloud& surfels,
                     const Found& found, const std::vector<int>& part) {
  const int parts = 1 + *std::max_element(part.begin(), part.end());
  const std::string class_name = state.class_name(found.row.class_id);
  std::vector<SceneInstance> rows{found.row};
  for (int k = 1; k < parts; ++k) {
    SceneInstance row = found.row;
    row.id = state.unused_instance_id(static_cast<std::size_t>(k) - 1);
    row.name = class_name + " " + std::to_string(row.id);
    rows.push_back(row);
  }
  const auto instance_of = [&](std::size_t k) {
    return rows[static_cast<std::size_t>(part[k])].id;
  };
  LabelEdit edit;
  edit.what = found.called() + " is split into " + std::to_string(parts);
  edit.labels.runs = label_runs(found.members, [&](std::size_t k) {
    return std::pair(found.row.class_id, instance_of(k));
  });
  edit.instances = boxed(surfels, found.members, instance_of, rows);
  return edit;
}

SurfelSet surfel_set(const renderer::SurfelCloud& surfels,
                     const std::vector<std::uint32_t>& members) {
  SurfelSet set;
  for (const std::uint32_t i : members) {
    set.position_m.push_back(surfels.position_m[i]);
    set.radius_m.push_back(std::max(surfels.scale_m[i].x, surfels.scale_m[i].y));
  }
  return set;
}

void check_gap(double gap_m) {
  if (gap_m >= 0.0 && gap_m <= 1.0) return;
  throw InputError::expected("gap", "0 to 1 m", std::to_string(gap_m));
}

}  // namespace

LabelEdit rename_instance(const LabelState& state, const renderer::SurfelCloud& surfels,
                          std::uint16_t instance, const NamedClass& to,
                          const std::string& name) {
  const Found found = find(state, instance);
  LabelEdit edit;
  const core::SceneClass target = class_named(state, to, edit);
  edit.what = found.called() + " is " + target.name;
  if (!target.thing) {
    set_all(found.members, target.id, 0, edit);
    edit.labels.moves = {{instance, 0}};
    edit.removed = {instance};
    return edit;
  }
  SceneInstance row = found.row;
  row.class_id = target.id;
  if (!name.empty()) {
    check_name(name, "name");
    row.name = name;
  } else if (target.id != found.row.class_id) {
    row.name = target.name + " " + std::to_string(instance);
  }
  const auto& classes = state.class_ids();
  if (found.listed && row.class_id == found.row.class_id && row.name == found.row.name &&
      std::all_of(found.members.begin(), found.members.end(),
                  [&](std::uint32_t i) { return classes[i] == target.id; })) {
    throw InputError::expected(found.called(), "another class or name", target.name);
  }
  if (row.name != found.row.name) edit.what += ", named " + row.name;
  set_all(found.members, target.id, instance, edit);
  edit.instances = found.listed ? std::vector<SceneInstance>{row}
                                : boxed(surfels, found.members,
                                        [&](std::size_t) { return instance; }, {row});
  return edit;
}

LabelEdit merge_instances(const LabelState& state, const renderer::SurfelCloud& surfels,
                          std::uint16_t instance, std::uint16_t into) {
  const Found from = find(state, instance), to = find(state, into);
  if (instance == into) {
    throw InputError::expected(from.called(), "another instance to merge it with", "itself");
  }
  require_class(state, to);
  std::vector<std::uint32_t> all;
  std::merge(from.members.begin(), from.members.end(), to.members.begin(), to.members.end(),
             std::back_inserter(all));
  LabelEdit edit;
  edit.what = from.called() + " is part of " + to.called();
  set_all(all, to.row.class_id, into, edit);
  edit.labels.moves = {{instance, into}};
  edit.instances = boxed(surfels, all, [&](std::size_t) { return into; }, {to.row});
  edit.removed = {instance};
  return edit;
}

LabelEdit split_into_pieces(const LabelState& state, const renderer::SurfelCloud& surfels,
                            std::uint16_t instance, double gap_m) {
  check_gap(gap_m);
  const Found found = find(state, instance);
  require_class(state, found);
  const std::vector<int> part =
      connected_pieces(surfel_set(surfels, found.members), gap_m, kLeastPiece);
  const int pieces = 1 + *std::max_element(part.begin(), part.end());
  if (pieces == 1 || pieces > kMostPieces) {
    char text[64];
    std::snprintf(text, sizeof text, "%d at a gap of %g m", pieces, gap_m);
    throw InputError::expected(
        found.called(), "2 to " + std::to_string(kMostPieces) + " pieces that do not touch",
        text);
  }
  return into_parts(state, surfels, found, part);
}

LabelEdit split_at_seeds(const LabelState& state, const renderer::SurfelCloud& surfels,
                         std::uint16_t instance, std::span<const Seed> seeds, double gap_m) {
  check_gap(gap_m);
  const Found found = find(state, instance);
  require_class(state, found);
  int parts = 0;
  for (const Seed& seed : seeds) parts = std::max(parts, seed.part + 1);
  for (int part = 0; part < std::max(parts, 2); ++part) {
    if (std::none_of(seeds.begin(), seeds.end(),
                     [&](const Seed& seed) { return seed.part == part; })) {
      throw InputError::expected(found.called(), "a click on every one of two or more parts",
                                 "none on part " + std::to_string(part + 1));
    }
  }
  const std::vector<int> part =
      nearest_seeds(surfel_set(surfels, found.members), gap_m, seeds);
  for (int k = 0; k < parts; ++k) {
    if (std::find(part.begin(), part.end(), k) == part.end()) {
      throw InputError::expected(found.called(), "clicks that lie apart",
                                 "no surfel for part " + std::to_string(k + 1));
    }
  }
  return into_parts(state, surfels, found, part);
}

LabelEdit delete_instance(const LabelState& state, std::uint16_t instance) {
  const Found found = find(state, instance);
  LabelEdit edit;
  edit.what = found.called() + " is deleted";
  set_all(found.members, 0, 0, edit);
  edit.labels.moves = {{instance, 0}};
  edit.removed = {instance};
  return edit;
}

}  // namespace segsim::experiments::scene_labels
