#pragma once

/// @file
/// Two detectors for one search, as VLFM has them: one of a closed set of classes, and a
/// prompted one for what that set lacks.

#include <memory>
#include <string>
#include <vector>

#include "core/stages.h"
#include "nav/vlfm/vlfm_policy.h"

namespace segsim::experiments::trials {

class RoutedDetector final : public core::Detector {
 public:
  /// Classes are those of `closed`, then those that only `open` has.
  RoutedDetector(std::unique_ptr<core::Detector> closed, std::unique_ptr<core::Detector> open);

  /// Which of them is shown the images that follow. With both, the open one sees those in
  /// which the closed one finds nothing of the target.
  void set_route(const nav::DetectorRoute& route, const std::string& target);

  [[nodiscard]] const std::vector<std::string>& closed_class_names() const {
    return closed_->class_names();
  }
  [[nodiscard]] const std::vector<std::string>& class_names() const override {
    return class_names_;
  }
  [[nodiscard]] std::vector<core::Detection> detect(
      const core::Observation& observation) override;

 private:
  std::unique_ptr<core::Detector> closed_, open_;
  std::vector<std::string> class_names_;
  std::vector<int> class_of_open_;  ///< Index in class_names_ by that of `open`.
  nav::DetectorRoute route_{true, false};
  int target_class_ = -1;
};

}  // namespace segsim::experiments::trials
