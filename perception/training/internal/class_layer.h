#pragma once

/// @file
/// Which parameters belong to classes, by their names in each of the networks:
///
///     class0.last.weight        small network: class0, class1, class2
///     class_head.last.weight    CenterNet
///     model.32.cv3.0.2.weight   YOLOv13: three levels

#include <string>

namespace segsim::perception {

[[nodiscard]] inline bool is_yolo_branch(const std::string& name) {
  return name.rfind("model.32.cv3.", 0) == 0;
}

/// Any layer between the map of a level and the logits of classes.
[[nodiscard]] inline bool is_class_branch(const std::string& name) {
  return is_yolo_branch(name) || name.rfind("class", 0) == 0;
}

/// The last layer of a class branch: one row for each class.
[[nodiscard]] inline bool is_class_layer(const std::string& name) {
  if (!is_class_branch(name)) return false;
  if (!is_yolo_branch(name)) return name.find(".last.") != std::string::npos;
  return name.find(".2.", std::string("model.32.cv3.").size()) != std::string::npos;
}

}  // namespace segsim::perception
