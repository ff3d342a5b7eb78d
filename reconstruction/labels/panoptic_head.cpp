#include "reconstruction/labels/panoptic_head.h"

#include <algorithm>
#include <cstdint>
#include <initializer_list>
#include <set>
#include <utility>

#include "core/check.h"
#include "core/error.h"
#include "reconstruction/labels/internal/head_list.h"
#include "reconstruction/labels/panoptic_config_fields.h"

namespace segsim::reconstruction {
namespace {

/// Checks every field against the range that its file may name.
class RangeChecker {
 public:
  void enter(const char* key) {
    path_.push_back(path_.empty() ? key : path_.back() + "." + key);
  }
  void leave() { path_.pop_back(); }

  void number(const char* key, double value, double lowest, double highest) const {
    SEGSIM_CHECK(value >= lowest && value <= highest, text(key, value));
  }
  template <class Integer>
  void integer(const char* key, Integer value, std::int64_t lowest,
               std::int64_t highest) const {
    const auto wide = static_cast<std::int64_t>(value);
    SEGSIM_CHECK(wide >= lowest && wide <= highest, text(key, wide));
  }
  void flag(const char*, bool) const {}
  template <class Choice>
  void choice(const char* key, Choice value, std::initializer_list<const char*> words) const {
    const auto index = static_cast<std::size_t>(value);
    SEGSIM_CHECK(index < words.size(), text(key, index));
  }

 private:
  template <class Value>
  [[nodiscard]] std::string text(const char* key, Value value) const {
    return path_.back() + "." + key + " = " + std::to_string(value);
  }

  std::vector<std::string> path_;
};

/// As panoptic_head_names() lists them.
const std::pair<const char*, internal::HeadMaker> kHeads[] = {
    {"query", internal::kMakeQuery},
    {"panoptic-splatting", internal::kMakePanopticSplatting},
    {"panoptic-lifting", internal::kMakePanopticLifting},
    {"contrastive-lift", internal::kMakeContrastiveLift},
    {"gaussian-grouping", internal::kMakeGaussianGrouping},
    {"open-gaussian", internal::kMakeOpenGaussian},
    {"panoptic-recon", internal::kMakePanopticRecon},
    {"panoptic-recon++", internal::kMakePanopticReconPlus},
    {"pvlff", internal::kMakePvlff},
};

}  // namespace

void check_panoptic_config(const PanopticTrainingConfig& config) {
  PanopticTrainingConfig copy = config;  // Visitors may write.
  RangeChecker checker;
  internal::visit_panoptic(copy, checker);
  // What concerns two fields (training_config.cpp asks the same of a file).
  const QueryConfig& query = config.query;
  SEGSIM_CHECK(
      query.min_sigma_m <= query.initial_sigma_m && query.initial_sigma_m <= query.max_sigma_m,
      "panoptic.query.initial_sigma_m = " + std::to_string(query.initial_sigma_m));
  const double share = config.sampling.stuff_share + config.sampling.instance_share;
  SEGSIM_CHECK(share <= 1.0,
               "panoptic.sampling.stuff_share + instance_share = " + std::to_string(share));
}

PanopticTrainingConfig recon_plus_config(PanopticTrainingConfig config) {
  const PanopticReconPlusConfig& plus = config.panoptic_recon_plus;
  QueryConfig& query = config.query;
  query.variant = renderer::LabelVariant::kRaw;
  query.seeding = QuerySeeding::kGrid;
  query.initial_sigma_m = plus.initial_sigma_m;
  query.max_sigma_m = std::max(query.max_sigma_m, plus.initial_sigma_m);
  query.max_dice = plus.max_dice;
  query.prune_from = plus.prune_from;
  query.prune_every = plus.prune_every;
  query.min_frames = 1;  // Only what was never matched goes.
  query.overlap_score = plus.overlap_score;
  config.rate.query_position_m = plus.query_position_m;
  config.rate.query_log_sigma = plus.query_log_sigma;
  config.rate.final_factor = plus.final_factor;
  config.rate.decay_from = 0.0;
  return config;
}

void PanopticHead::move_surfels(const std::vector<glm::vec3>&) {
  SEGSIM_CHECK(false, "a head that is not trained jointly");
}

std::unique_ptr<PanopticHead> make_panoptic_head(const std::string& name,
                                                 PanopticHeadInputs inputs,
                                                 const PanopticTrainingConfig& config,
                                                 std::uint64_t seed) {
  check_panoptic_config(config);
  SEGSIM_CHECK(!inputs.classes.empty(), "no classes");
  std::set<std::uint16_t> ids;
  for (const core::SceneClass& c : inputs.classes) {
    SEGSIM_CHECK(c.id != 0 && ids.insert(c.id).second, "class " + std::to_string(c.id));
  }
  for (const auto& [known, make] : kHeads) {
    if (name == known) return make(std::move(inputs), config, seed);
  }
  throw core::InputError::expected("head", panoptic_head_list(", "), "\"" + name + "\"");
}

}  // namespace segsim::reconstruction
