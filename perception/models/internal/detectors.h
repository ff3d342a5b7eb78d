#pragma once

#include <memory>

#include "perception/models/model_description.h"
#include "perception/models/object_detector.h"

namespace segsim::perception {

[[nodiscard]] std::unique_ptr<core::Detector> make_yolo(const ModelDescription& description,
                                                        const ObjectDetectorOptions& options);
[[nodiscard]] std::unique_ptr<core::Detector> make_grounding_dino(
    const ModelDescription& description, const ObjectDetectorOptions& options);

/// Names of Ultralytics' metadata: a Python dict, {0: 'person', 1: "cat's eye"}, or JSON.
/// @throws core::InputError that starts with `place` for other text.
[[nodiscard]] std::vector<std::string> parse_class_names(const std::string& text,
                                                         const std::string& place);

}  // namespace segsim::perception
