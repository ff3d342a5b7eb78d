#pragma once

/// @file
/// A detector that reads the answer off the rendered labels: the upper bound of an experiment,
/// or, with less recall and shaken boxes, a detector of known quality.

#include <cstdint>
#include <string>
#include <vector>

#include "core/scene_bundle.h"
#include "core/stages.h"
#include "sim/trial/trial.h"

namespace segsim::sim {

struct OracleDetectorOptions {
  int min_pixels = 40;        ///< Smaller instances are not reported.
  double recall = 1.0;        ///< Chance to report an instance, drawn per capture.
  double jitter_share = 0.0;  ///< Sigma of each box side's shift, relative to the box's size.
  std::uint64_t seed = 0;     ///< Mixed with that of the episode.
};

class OracleDetector final : public core::Detector, public GroundTruthSink {
 public:
  /// @param classes  Of the scene: how its class ids are called.
  /// @param class_names  What to report; a name that the scene lacks is never seen.
  OracleDetector(const std::vector<core::SceneClass>& classes,
                 std::vector<std::string> class_names,
                 const OracleDetectorOptions& options = {});

  [[nodiscard]] const std::vector<std::string>& class_names() const override {
    return class_names_;
  }
  /// Boxes of the frame that `set_truth` was last given; ordered by score, then instance id.
  [[nodiscard]] std::vector<core::Detection> detect(
      const core::Observation& observation) override;
  /// Where a phrase says which objects of a class are meant, it reports no others of it.
  void begin_episode(const Episode& episode) override;
  void set_truth(const core::Frame& frame) override;

 private:
  struct Seen {
    std::uint16_t instance = 0, semantic = 0;
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0;  ///< Half-open.
    int pixels = 0;
  };

  std::vector<std::string> class_names_;
  std::vector<int> class_index_;  ///< By scene class id; -1 = not reported.
  OracleDetectorOptions options_;
  std::uint64_t episode_seed_ = 0;
  int phrase_class_ = -1;  ///< Index of the class that the phrase is about; -1: no phrase.
  std::vector<std::uint16_t> phrase_instances_;
  int width_px_ = 0, height_px_ = 0;
  std::vector<Seen> seen_;  ///< Ascending instance id.
};

}  // namespace segsim::sim
