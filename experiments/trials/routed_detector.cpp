#include "experiments/trials/routed_detector.h"

#include <algorithm>
#include <utility>

namespace segsim::experiments::trials {

RoutedDetector::RoutedDetector(std::unique_ptr<core::Detector> closed,
                               std::unique_ptr<core::Detector> open)
    : closed_(std::move(closed)),
      open_(std::move(open)),
      class_names_(closed_->class_names()) {
  for (const std::string& name : open_->class_names()) {
    const auto found = std::find(class_names_.begin(), class_names_.end(), name);
    class_of_open_.push_back(static_cast<int>(found - class_names_.begin()));
    if (found == class_names_.end()) class_names_.push_back(name);
  }
}

void RoutedDetector::set_route(const nav::DetectorRoute& route, const std::string& target) {
  route_ = route;
  const auto found = std::find(class_names_.begin(), class_names_.end(), target);
  target_class_ =
      found == class_names_.end() ? -1 : static_cast<int>(found - class_names_.begin());
}

std::vector<core::Detection> RoutedDetector::detect(const core::Observation& observation) {
  std::vector<core::Detection> all;
  if (route_.closed_set) all = closed_->detect(observation);
  const bool found = std::any_of(all.begin(), all.end(), [&](const core::Detection& d) {
    return d.class_index == target_class_;
  });
  if (!route_.open_set || found) return all;
  for (core::Detection detection : open_->detect(observation)) {
    detection.class_index = class_of_open_[static_cast<std::size_t>(detection.class_index)];
    all.push_back(detection);
  }
  std::stable_sort(
      all.begin(), all.end(),
      [](const core::Detection& a, const core::Detection& b) { return a.score > b.score; });
  return all;
}

}  // namespace segsim::experiments::trials
