#pragma once

/// @file
/// The labels of a scene while they are corrected: what every surfel is, which classes and
/// instances there are, and what differs from how the scene was made.

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "core/scene_bundle.h"
#include "renderer/files/label_edits.h"
#include "renderer/scene/surfels.h"

namespace segsim::experiments::scene_labels {

/// One correction as what it leaves behind, so that no later program can understand it in
/// another way.
struct LabelEdit {
  std::string what;  ///< One line for people: "couch 1 is a bed".
  /// Surfels get these labels; and shares of label distributions move.
  renderer::LabelEdits labels;
  std::vector<core::SceneClass> new_classes;
  std::vector<core::SceneInstance> instances;  ///< Rows that are added, or replaced by id.
  std::vector<std::uint16_t> removed;          ///< Instances that are no more.
};

class LabelState {
 public:
  /// @param surfels  As they were made, with ids.
  /// @param start  In effect already; the tables know them.
  LabelState(const renderer::SurfelCloud& surfels, std::vector<core::SceneClass> classes,
             std::vector<core::SceneInstance> instances, const renderer::LabelEdits& start);

  void apply(const LabelEdit& edit);

  [[nodiscard]] const std::vector<core::SceneClass>& classes() const { return classes_; }
  /// In the order of the bundle, new ones last.
  [[nodiscard]] const std::vector<core::SceneInstance>& instances() const {
    return instances_;
  }
  /// nullptr: no such row. Surfels may have an instance of no row.
  [[nodiscard]] const core::SceneInstance* find_instance(std::uint16_t id) const;
  [[nodiscard]] const core::SceneClass* find_class(const std::string& name) const;
  [[nodiscard]] std::string class_name(std::uint16_t id) const;

  /// Of every surfel.
  [[nodiscard]] const std::vector<std::uint16_t>& class_ids() const { return class_id_; }
  [[nodiscard]] const std::vector<std::uint16_t>& instance_ids() const { return instance_id_; }
  /// Surfels of an instance, ascending.
  [[nodiscard]] std::vector<std::uint32_t> members(std::uint16_t instance) const;
  /// Never used in this scene, not even by an instance that is no more.
  /// @throws core::InputError if all 65535 are taken.
  [[nodiscard]] std::uint16_t unused_instance_id(std::size_t next = 0) const;
  /// @throws core::InputError if all 65535 are taken.
  [[nodiscard]] std::uint16_t unused_class_id() const;

  /// All that was set by hand.
  [[nodiscard]] renderer::LabelEdits label_edits() const;

 private:
  void set(const renderer::LabelEdits& labels);

  std::vector<core::SceneClass> classes_;
  std::vector<core::SceneInstance> instances_;
  std::vector<std::uint16_t> class_id_, instance_id_;
  std::vector<std::uint8_t> by_hand_;  ///< Of every surfel: its label was set.
  std::map<std::uint16_t, std::uint16_t> moves_;
  std::uint16_t highest_instance_ = 0;
};

/// Neighbouring surfels of one label as runs. @param surfels  Ascending.
/// @param label_of  (class, instance) of the k-th of them.
template <class LabelOf>
std::vector<renderer::LabelEdits::Run> label_runs(const std::vector<std::uint32_t>& surfels,
                                                  const LabelOf& label_of) {
  std::vector<renderer::LabelEdits::Run> runs;
  for (std::size_t k = 0; k < surfels.size(); ++k) {
    const auto [class_id, instance_id] = label_of(k);
    if (!runs.empty()) {
      renderer::LabelEdits::Run& last = runs.back();
      if (last.first + last.count == surfels[k] && last.class_id == class_id &&
          last.instance_id == instance_id) {
        ++last.count;
        continue;
      }
    }
    runs.push_back({surfels[k], 1, class_id, instance_id});
  }
  return runs;
}

}  // namespace segsim::experiments::scene_labels
