#pragma once

/// @file
/// The default image-text scorer: a documented prior over rooms instead of a network. Objects
/// in view say in which kind of room the camera looks; the room says how likely the target is
/// there.
///
///     P(room | view) ~ prod_d  (s_d P(o_d | room) + (1 - s_d) / |objects|),   d: detections
///     score = sum_room P(room | view) P(target | room)
///
/// with the detection's score s_d, uniform rooms, and P(. | room) from a data file of ratings
/// (nav/policies/data/semantic_prior.yaml). With nothing in view the score is the mean over
/// rooms. Of several boxes of one class the best counts.

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/config.h"
#include "nav/value/image_text_scorer.h"

namespace segsim::nav {

class SemanticPrior {
 public:
  static constexpr const char* kSchema = "segsim.semantic_prior/1";

  /// @throws core::InputError with file, line and key.
  [[nodiscard]] static SemanticPrior load(const std::filesystem::path& file);
  [[nodiscard]] static SemanticPrior parse(const std::string& text, const std::string& origin);

  [[nodiscard]] const std::vector<std::string>& rooms() const { return rooms_; }
  [[nodiscard]] bool knows(const std::string& object) const {
    return presence_.count(object) != 0;
  }
  /// Chance that a room of this kind has the object; the smallest level for unknown objects.
  [[nodiscard]] double presence(const std::string& object, std::size_t room) const;
  /// P(room | objects seen with scores); uniform without known ones.
  [[nodiscard]] std::vector<double> room_posterior(
      const std::map<std::string, double>& seen) const;
  /// In [0, 1].
  [[nodiscard]] double score(const std::map<std::string, double>& seen,
                             const std::string& target) const;

 private:
  [[nodiscard]] static SemanticPrior read(const core::ConfigNode& root);

  std::vector<std::string> rooms_;
  std::map<std::string, std::vector<double>> presence_;
  double lowest_ = 0.0;
};

/// @param class_names  Of the detector, by class index.
[[nodiscard]] std::unique_ptr<ImageTextScorer> make_semantic_scorer(
    const SemanticPrior& prior, const std::vector<std::string>& class_names);

}  // namespace segsim::nav
