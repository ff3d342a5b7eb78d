#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>

#include <gmock/gmock.h>

#include "core/check.h"
#include "core/error.h"
#include "tests/reconstruction/labels/label_scene.h"

namespace segsim::reconstruction {
namespace {

namespace fs = std::filesystem;

/// One step on a batch made by hand.
class OneStep : public ::testing::Test {
 protected:
  static double value_of(const std::vector<NamedLoss>& losses, const std::string& name) {
    for (const NamedLoss& loss : losses) {
      if (loss.name == name) return loss.value;
    }
    return -1.0;
  }

  OneStep() {
    config_.sampling.min_alpha = 0.5;
    config_.query.min_mask_pixels = 1;
    config_.rate.scale = 1e-9;  // The losses of several steps can be compared.
  }
  /// Surfels in a row, 1 cm apart; pixel p sees surfel p alone.
  void add_pixels(int count, std::uint16_t semantic, std::uint16_t instance,
                  float alpha = 0.9F) {
    for (int i = 0; i < count; ++i) {
      position_m_.emplace_back(0.01F * static_cast<float>(position_m_.size()), 0.0F, 0.0F);
      surfel_.push_back(static_cast<std::int32_t>(surfel_.size()));
      weight_.push_back(alpha);
      start_.push_back(static_cast<std::int32_t>(surfel_.size()));
      semantic_.push_back(semantic);
      instance_.push_back(instance);
    }
  }
  [[nodiscard]] std::unique_ptr<PanopticHead> make(const std::string& name) const {
    return make_panoptic_head(name,
                              {.position_m = position_m_,
                               .R_world_surfel = {},
                               .classes = testing::label_scene_classes(),
                               .query_seeds = seeds_,
                               .object_of_mask = {},
                               .object_class = {}},
                              config_, 1);
  }
  [[nodiscard]] PanopticBatch batch() const {
    PanopticBatch batch;
    batch.weights = {static_cast<std::int64_t>(surfel_.size()),
                     static_cast<std::int64_t>(surfel_.size()), start_.data(), surfel_.data(),
                     weight_.data()};
    batch.semantic = semantic_.data();
    batch.instance = instance_.data();
    batch.confidence = confidence_.empty() ? nullptr : confidence_.data();
    return batch;
  }
  [[nodiscard]] std::vector<NamedLoss> step() const { return make("query")->step(batch(), 0); }

  PanopticTrainingConfig config_;
  std::vector<glm::vec3> position_m_;
  std::vector<QuerySeed> seeds_{{{0.0F, 0.0F, 0.0F}}, {{0.5F, 0.0F, 0.0F}}};
  std::vector<std::int32_t> start_{0}, surfel_;
  std::vector<float> weight_;
  std::vector<std::uint16_t> semantic_, instance_;
  std::vector<float> confidence_;
};

TEST_F(OneStep, ClassesAndDiceOfPanopticReconPlusEndInItsLastStage) {
  add_pixels(10, 1, 0);
  add_pixels(10, 3, 1);
  const auto head = make("panoptic-recon++");
  const auto first = head->step(batch(), 0);
  EXPECT_GT(value_of(first, "semantic"), 0.0);
  EXPECT_GT(value_of(first, "dice"), 0.0);
  EXPECT_EQ(value_of(first, "panoptic"), -1.0);
  const auto last = head->step(batch(), config_.iterations - 1);
  EXPECT_EQ(value_of(last, "semantic"), -1.0);
  EXPECT_EQ(value_of(last, "dice"), -1.0);
  EXPECT_GT(value_of(last, "bce"), 0.0);
  EXPECT_GT(value_of(last, "panoptic"), 0.0);
}

TEST_F(OneStep, UnlabelledPixelsAreNegativesOfPanopticReconPlusAsPublished) {
  add_pixels(10, 1, 0);
  add_pixels(10, 3, 1);
  add_pixels(20, 0, 0);
  const double published = value_of(make("panoptic-recon++")->step(batch(), 0), "dice");
  config_.panoptic_recon_plus.unlabelled_negative = false;
  const double ignored = value_of(make("panoptic-recon++")->step(batch(), 0), "dice");
  EXPECT_GT(published, ignored + 0.01);
}

TEST_F(OneStep, OnlyHeadsOfQueriesFollowTheSurfels) {
  add_pixels(10, 1, 0);
  add_pixels(10, 3, 1);
  const std::vector<std::string> joint = joint_head_names();
  for (const std::string& name : panoptic_head_names()) {
    const auto head = make(name);
    if (std::find(joint.begin(), joint.end(), name) != joint.end()) {
      const std::vector<glm::vec3> here = position_m_;
      const double before = value_of(make(name)->step(batch(), 0), "dice");
      for (glm::vec3& p : position_m_) p += glm::vec3(0.2F, 0.1F, 0.0F);
      head->move_surfels(position_m_);
      const double moved = value_of(head->step(batch(), 0), "dice");
      EXPECT_EQ(moved, value_of(make(name)->step(batch(), 0), "dice")) << name;
      EXPECT_GT(std::abs(moved - before), 1e-4) << name;
      position_m_ = here;
    } else {
      EXPECT_THROW(head->move_surfels(position_m_), core::ContractViolation) << name;
    }
  }
}

TEST_F(OneStep, UntrainedLossesAreThoseOfEqualProbabilities) {
  add_pixels(10, 1, 0);
  add_pixels(10, 3, 1);
  config_.query.variant = renderer::LabelVariant::kRaw;
  const auto losses = step();
  // Classes: the decoder's bias and the features are 0. log 5.
  EXPECT_NEAR(value_of(losses, "semantic"), std::log(5.0), 1e-4);
  // Every similarity is 1/2: M of query 0 falls from 1/2 at x = 0 as exp(-x^2 / 0.5).
  double both = 0.0, mass = 0.0, bce = 0.0, other_both = 0.0, other_mass = 0.0;
  for (int p = 0; p < 20; ++p) {
    const double x = 0.01 * p, t = p >= 10 ? 1.0 : 0.0;
    const double m = 0.5 * std::exp(-0.5 * x * x / 0.25);
    const double n = 0.5 * std::exp(-0.5 * (x - 0.5) * (x - 0.5) / 0.25);
    both += m * t, mass += m, other_both += n * t, other_mass += n;
    bce -= (t * std::log(n) + (1.0 - t) * std::log(1.0 - n)) / 20.0;
  }
  // Query 1 is the better one: its mask grows towards the instance.
  const double dice0 = 1.0 - 2.0 * both / (mass + 10.0);
  const double dice1 = 1.0 - 2.0 * other_both / (other_mass + 10.0);
  EXPECT_NEAR(value_of(losses, "dice"), dice1, 1e-4);
  EXPECT_NEAR(value_of(losses, "bce"), bce, 1e-4);
  EXPECT_NE(dice0, dice1);
}

TEST_F(OneStep, VoidPixelsSayNothingUnlessThePolicyMakesThemNegatives) {
  add_pixels(10, 1, 0);
  add_pixels(10, 3, 1);
  const auto before = step();
  add_pixels(20, 0, 0);
  const auto ignored = step();
  for (std::size_t i = 0; i < before.size(); ++i) {
    if (before[i].name == "class") continue;  // Visibility is a share of the pixels.
    EXPECT_NEAR(ignored[i].value, before[i].value, 1e-6) << before[i].name;
  }
  config_.void_policy = VoidPolicy::kNegative;
  const auto negative = step();
  EXPECT_GT(value_of(negative, "dice"), value_of(before, "dice") + 0.01);
  EXPECT_NEAR(value_of(negative, "semantic"), value_of(before, "semantic"), 1e-6);
}

TEST_F(OneStep, PixelsThatSurfelsHardlyCoverSayNothing) {
  add_pixels(10, 1, 0);
  add_pixels(10, 3, 1);
  const auto before = step();
  add_pixels(30, 4, 2, 0.3F);
  const auto after = step();
  EXPECT_NEAR(value_of(after, "total"), value_of(before, "total"), 1e-6);
}

TEST_F(OneStep, RejectedMasksAreIgnoredAndNotTheLastStuffClass) {
  add_pixels(10, 1, 0);
  add_pixels(10, 3, 1);
  config_.rate.scale = 5.0;
  config_.loss.panoptic_from = 0.9;
  config_.query.gate_from = 0.0;
  config_.query.max_dice = 0.0;  // No match is good enough.
  const auto head = make("query");
  for (int i = 0; i < 40; ++i) {
    const auto losses = head->step(batch(), i);
    EXPECT_EQ(value_of(losses, "dice"), -1.0);
    EXPECT_EQ(value_of(losses, "bce"), -1.0);
    EXPECT_EQ(value_of(losses, "panoptic"), -1.0);
  }
  const auto losses = head->step(batch(), config_.iterations - 1);
  // The floor is known by now. Were the chair's pixels taken for the wall, they would cost
  // half of -log P(wall), which is small where the chair is known.
  EXPECT_LT(value_of(losses, "semantic"), 0.2);
  EXPECT_GT(value_of(losses, "panoptic"), 0.0);
  EXPECT_LT(value_of(losses, "panoptic"), 0.2);
}

TEST_F(OneStep, ConfidenceScalesPixelLosses) {
  add_pixels(10, 1, 0);
  add_pixels(10, 3, 1);
  const auto sure = step();
  confidence_.assign(20, 0.5F);
  const auto unsure = step();
  EXPECT_NEAR(value_of(unsure, "semantic"), 0.5 * value_of(sure, "semantic"), 1e-6);
  EXPECT_NEAR(value_of(unsure, "bce"), 0.5 * value_of(sure, "bce"), 1e-6);
  EXPECT_NEAR(value_of(unsure, "dice"), value_of(sure, "dice"), 1e-6);
  config_.use_confidence = false;
  EXPECT_NEAR(value_of(step(), "total"), value_of(sure, "total"), 1e-6);
}

TEST_F(OneStep, FramesWithoutLabelsAndScenesWithoutQueriesAreStepsToo) {
  add_pixels(10, 0, 0);
  EXPECT_EQ(step().back().value, 0.0);
  semantic_.assign(10, 3);
  instance_.assign(10, 4);
  seeds_.clear();
  const auto losses = step();
  EXPECT_NEAR(value_of(losses, "total"), std::log(5.0), 1e-4);
}

TEST_F(OneStep, BadInputIsRefused) {
  add_pixels(10, 77, 0);  // Not in the table.
  EXPECT_THROW(static_cast<void>(step()), core::InputError);
  EXPECT_THROW(static_cast<void>(make("panoptic-surgery")), core::InputError);
  config_.query.max_overlap = 1.5;
  EXPECT_THROW(static_cast<void>(make("query")), core::ContractViolation);
}

/// One field after another out of its range.
TEST(PanopticConfig, FieldsOutOfTheirRangeAreNamed) {
  const auto message = [](auto change) -> std::string {
    PanopticTrainingConfig config;
    change(config);
    try {
      check_panoptic_config(config);
    } catch (const core::ContractViolation& error) {
      return error.what();
    }
    return "no error";
  };
  using Config = PanopticTrainingConfig;
  using ::testing::HasSubstr;
  EXPECT_EQ(message([](Config&) {}), "no error");
  EXPECT_THAT(message([](Config& c) { c.iterations = 0; }),
              HasSubstr("panoptic.iterations = 0"));
  EXPECT_THAT(message([](Config& c) { c.query.max_overlap = 1.5; }),
              HasSubstr("panoptic.query.max_overlap = 1.5"));
  EXPECT_THAT(message([](Config& c) { c.loss.dice = NAN; }), HasSubstr("panoptic.loss.dice"));
  EXPECT_THAT(message([](Config& c) { c.loss.bce = INFINITY; }),
              HasSubstr("panoptic.loss.bce"));
  EXPECT_THAT(message([](Config& c) { c.rate.scale = 0.0; }),
              HasSubstr("panoptic.rate.scale"));
  EXPECT_THAT(message([](Config& c) { c.sampling.even_share = -0.1; }),
              HasSubstr("panoptic.sampling.even_share"));
  EXPECT_THAT(message([](Config& c) { c.panoptic_lifting.slots = 65535; }),
              HasSubstr("panoptic.panoptic_lifting.slots = 65535"));
  EXPECT_THAT(message([](Config& c) { c.void_policy = static_cast<VoidPolicy>(7); }),
              HasSubstr("panoptic.void_policy = 7"));
  EXPECT_THAT(message([](Config& c) { c.query.initial_sigma_m = 5.0; }),
              HasSubstr("panoptic.query.initial_sigma_m = 5"));
  EXPECT_THAT(message([](Config& c) {
                c.sampling.stuff_share = 0.7;
                c.sampling.instance_share = 0.4;
              }),
              HasSubstr("stuff_share + instance_share"));
}

TEST_F(OneStep, StatesOfAnotherHeadOrSceneAreRefused) {
  add_pixels(10, 1, 0);
  const fs::path file = fs::path(::testing::TempDir()) / "heads_other.state";
  make("query")->save(file);
  EXPECT_NO_THROW(make("query")->load(file));
  EXPECT_THROW(make("panoptic-lifting")->load(file), core::InputError);
  EXPECT_THROW(make("panoptic-splatting")->load(file), core::InputError);
  add_pixels(1, 1, 0);
  EXPECT_THROW(make("query")->load(file), core::InputError);
  fs::remove(file);
}

}  // namespace
}  // namespace segsim::reconstruction
