#include "nav/value/semantic_prior.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/check.h"

namespace segsim::nav {
namespace {

class ConstantScorer final : public ImageTextScorer {
 public:
  explicit ConstantScorer(double value) : value_(value) {
    SEGSIM_CHECK(value >= 0.0 && value <= 1.0, "value " + std::to_string(value));
  }
  double score(const core::Observation&, std::span<const core::Detection>,
               const core::ObjectGoal&) override {
    return value_;
  }

 private:
  double value_;
};

class OpenSpaceScorer final : public ImageTextScorer {
 public:
  explicit OpenSpaceScorer(double range_m) : range_m_(range_m) {
    SEGSIM_CHECK(range_m > 0.0, "range_m");
  }
  double score(const core::Observation& observation, std::span<const core::Detection>,
               const core::ObjectGoal&) override {
    SEGSIM_CHECK(observation.depth_m != nullptr, "observation without depth");
    const core::Image<float>& depth_m = *observation.depth_m;
    const int first = depth_m.height_px() / 4, last = depth_m.height_px() - first;
    double sum = 0.0;
    std::size_t count = 0;
    for (int y = first; y < last; ++y) {
      for (int x = 0; x < depth_m.width_px(); ++x, ++count) {
        const auto depth = static_cast<double>(depth_m(x, y));
        if (depth > 0.0) sum += std::min(depth, range_m_);
      }
    }
    return count == 0 ? 0.0 : sum / (range_m_ * static_cast<double>(count));
  }

 private:
  double range_m_;
};

class SemanticScorer final : public ImageTextScorer {
 public:
  SemanticScorer(SemanticPrior prior, std::vector<std::string> class_names)
      : prior_(std::move(prior)), class_names_(std::move(class_names)) {}
  double score(const core::Observation&, std::span<const core::Detection> detections,
               const core::ObjectGoal& target) override {
    std::map<std::string, double> seen;
    for (const core::Detection& detection : detections) {
      const auto index = static_cast<std::size_t>(detection.class_index);
      if (detection.class_index < 0 || index >= class_names_.size()) continue;
      double& best = seen[class_names_[index]];
      best = std::max(best, static_cast<double>(detection.score));
    }
    return prior_.score(seen, target.class_name);
  }

 private:
  SemanticPrior prior_;
  std::vector<std::string> class_names_;
};

}  // namespace

std::unique_ptr<ImageTextScorer> make_constant_scorer(double value) {
  return std::make_unique<ConstantScorer>(value);
}

std::unique_ptr<ImageTextScorer> make_open_space_scorer(double range_m) {
  return std::make_unique<OpenSpaceScorer>(range_m);
}

std::unique_ptr<ImageTextScorer> make_semantic_scorer(
    const SemanticPrior& prior, const std::vector<std::string>& class_names) {
  return std::make_unique<SemanticScorer>(prior, class_names);
}

SemanticPrior SemanticPrior::load(const std::filesystem::path& file) {
  return read(core::ConfigNode::load(file));
}

SemanticPrior SemanticPrior::parse(const std::string& text, const std::string& origin) {
  return read(core::ConfigNode::parse(text, origin));
}

SemanticPrior SemanticPrior::read(const core::ConfigNode& root) {
  SemanticPrior prior;
  if (root.text("schema") != kSchema) {
    root.child("schema").fail(kSchema, "\"" + root.text("schema") + "\"");
  }
  (void)root.texts("sources");
  const std::vector<double> levels = root.numbers("levels");
  if (levels.size() < 2 || !std::is_sorted(levels.begin(), levels.end()) ||
      levels.front() <= 0.0 || levels.back() > 1.0) {
    root.child("levels").fail("two or more ascending chances in (0, 1]", "another list");
  }
  prior.lowest_ = levels.front();
  prior.rooms_ = root.texts("rooms");
  if (prior.rooms_.empty()) root.child("rooms").fail("at least one room", "none");
  const core::ConfigNode objects = root.child("objects");
  for (const std::string& name : objects.keys()) {
    const std::vector<double> ratings = objects.numbers(name);
    if (ratings.size() != prior.rooms_.size()) {
      objects.child(name).fail(
          "one rating per room (" + std::to_string(prior.rooms_.size()) + ")",
          std::to_string(ratings.size()));
    }
    std::vector<double>& chances = prior.presence_[name];
    for (const double rating : ratings) {
      if (rating != std::floor(rating) || rating < 0.0 ||
          rating >= static_cast<double>(levels.size())) {
        objects.child(name).fail("ratings 0 .. " + std::to_string(levels.size() - 1),
                                 std::to_string(rating));
      }
      chances.push_back(levels[static_cast<std::size_t>(rating)]);
    }
  }
  objects.finish();
  root.finish();
  return prior;
}

double SemanticPrior::presence(const std::string& object, std::size_t room) const {
  SEGSIM_CHECK(room < rooms_.size(), "room " + std::to_string(room));
  const auto found = presence_.find(object);
  return found == presence_.end() ? lowest_ : found->second[room];
}

std::vector<double> SemanticPrior::room_posterior(
    const std::map<std::string, double>& seen) const {
  // P(object | room) is the presence, normalised over objects.
  std::vector<double> totals(rooms_.size(), 0.0);
  for (const auto& [object, chances] : presence_) {
    for (std::size_t r = 0; r < rooms_.size(); ++r) totals[r] += chances[r];
  }
  std::vector<double> posterior(rooms_.size(), 1.0);
  for (const auto& [object, raw_score] : seen) {
    if (!knows(object)) continue;
    const double score = std::clamp(raw_score, 0.0, 1.0);
    for (std::size_t r = 0; r < rooms_.size(); ++r) {
      posterior[r] *= score * presence(object, r) / totals[r] +
                      (1.0 - score) / static_cast<double>(presence_.size());
    }
  }
  const double sum = std::accumulate(posterior.begin(), posterior.end(), 0.0);
  for (double& p : posterior) p /= sum;
  return posterior;
}

double SemanticPrior::score(const std::map<std::string, double>& seen,
                            const std::string& target) const {
  const std::vector<double> posterior = room_posterior(seen);
  double score = 0.0;
  for (std::size_t r = 0; r < rooms_.size(); ++r) score += posterior[r] * presence(target, r);
  return score;
}

}  // namespace segsim::nav
