#include "experiments/scene_labels/label_state.h"

#include <algorithm>
#include <utility>

#include "core/check.h"
#include "core/error.h"

namespace segsim::experiments::scene_labels {
namespace {

constexpr std::size_t kMostIds = 65535;

std::uint16_t checked_id(std::size_t id, const char* what) {
  if (id > kMostIds) {
    throw core::InputError::expected(what, "at most " + std::to_string(kMostIds), "one more");
  }
  return static_cast<std::uint16_t>(id);
}

}  // namespace

LabelState::LabelState(const renderer::SurfelCloud& surfels,
                       std::vector<core::SceneClass> classes,
                       std::vector<core::SceneInstance> instances,
                       const renderer::LabelEdits& start)
    : classes_(std::move(classes)),
      instances_(std::move(instances)),
      class_id_(surfels.semantic_id),
      instance_id_(surfels.instance_id),
      by_hand_(surfels.size(), 0) {
  SEGSIM_CHECK(surfels.has_labels() || surfels.size() == 0, "surfels with ids");
  for (const core::SceneInstance& i : instances_) {
    highest_instance_ = std::max(highest_instance_, i.id);
  }
  for (const std::uint16_t id : instance_id_) {
    highest_instance_ = std::max(highest_instance_, id);
  }
  set(start);
}

void LabelState::set(const renderer::LabelEdits& labels) {
  for (const renderer::LabelEdits::Run& run : labels.runs) {
    SEGSIM_CHECK(std::size_t{run.first} + run.count <= by_hand_.size(), "a run of surfels");
    std::fill_n(class_id_.begin() + run.first, run.count, run.class_id);
    std::fill_n(instance_id_.begin() + run.first, run.count, run.instance_id);
    std::fill_n(by_hand_.begin() + run.first, run.count, std::uint8_t{1});
    highest_instance_ = std::max(highest_instance_, run.instance_id);
  }
  for (const renderer::LabelEdits::Move& move : labels.moves) {
    for (auto& [from, to] : moves_) {
      if (to == move.from) to = move.to;
    }
    moves_[move.from] = move.to;
    highest_instance_ = std::max(highest_instance_, move.from);
  }
}

void LabelState::apply(const LabelEdit& edit) {
  set(edit.labels);
  classes_.insert(classes_.end(), edit.new_classes.begin(), edit.new_classes.end());
  std::erase_if(instances_, [&](const core::SceneInstance& i) {
    return std::find(edit.removed.begin(), edit.removed.end(), i.id) != edit.removed.end();
  });
  for (const core::SceneInstance& row : edit.instances) {
    const auto known =
        std::find_if(instances_.begin(), instances_.end(),
                     [&](const core::SceneInstance& i) { return i.id == row.id; });
    if (known != instances_.end()) {
      *known = row;
    } else {
      instances_.push_back(row);
    }
  }
}

const core::SceneInstance* LabelState::find_instance(std::uint16_t id) const {
  for (const core::SceneInstance& i : instances_) {
    if (i.id == id) return &i;
  }
  return nullptr;
}

const core::SceneClass* LabelState::find_class(const std::string& name) const {
  for (const core::SceneClass& c : classes_) {
    if (c.name == name) return &c;
  }
  return nullptr;
}

std::string LabelState::class_name(std::uint16_t id) const {
  for (const core::SceneClass& c : classes_) {
    if (c.id == id) return c.name;
  }
  return "void";
}

std::vector<std::uint32_t> LabelState::members(std::uint16_t instance) const {
  std::vector<std::uint32_t> members;
  for (std::size_t i = 0; i < instance_id_.size(); ++i) {
    if (instance_id_[i] == instance) members.push_back(static_cast<std::uint32_t>(i));
  }
  return members;
}

std::uint16_t LabelState::unused_instance_id(std::size_t next) const {
  return checked_id(std::size_t{highest_instance_} + 1 + next, "instances of a scene");
}

std::uint16_t LabelState::unused_class_id() const {
  std::size_t highest = 0;
  for (const core::SceneClass& c : classes_) highest = std::max<std::size_t>(highest, c.id);
  for (const std::uint16_t id : class_id_) highest = std::max<std::size_t>(highest, id);
  return checked_id(highest + 1, "classes of a scene");
}

renderer::LabelEdits LabelState::label_edits() const {
  std::vector<std::uint32_t> edited;
  for (std::size_t i = 0; i < by_hand_.size(); ++i) {
    if (by_hand_[i] != 0) edited.push_back(static_cast<std::uint32_t>(i));
  }
  renderer::LabelEdits edits;
  edits.runs = label_runs(edited, [&](std::size_t k) {
    return std::pair(class_id_[edited[k]], instance_id_[edited[k]]);
  });
  for (const auto& [from, to] : moves_) edits.moves.push_back({from, to});
  return edits;
}

}  // namespace segsim::experiments::scene_labels
