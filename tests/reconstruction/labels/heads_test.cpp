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

using testing::LabelScene;
namespace fs = std::filesystem;

class Heads : public ::testing::Test {
 protected:
  static LabelScene& scene() {
    static LabelScene scene;
    scene.set_masks(1);
    return scene;
  }
  static double value_of(const std::vector<NamedLoss>& losses, const std::string& name) {
    for (const NamedLoss& loss : losses) {
      if (loss.name == name) return loss.value;
    }
    return -1.0;
  }
};

TEST_F(Heads, ExactMasksWithShuffledIdsGiveOneIdPerObject) {
  const auto head = scene().train("query", LabelScene::config());
  const PanopticResult result = head->result();
  const PanopticQuality quality = scene().evaluate(result.field);
  EXPECT_GT(quality.pq, 0.93);
  EXPECT_GT(quality.rq, 0.99);
  ASSERT_TRUE(result.model.has_value());
  EXPECT_EQ(result.model->queries.size(), 7U);  // As many as objects.
  EXPECT_EQ(result.semantic_feature.size(), scene().cloud().size());
}

/// Queries that begin on a grid (22 seeds for 7 objects) have to find their objects.
PanopticTrainingConfig grid_config() {
  PanopticTrainingConfig config = LabelScene::config();
  config.query.seeding = QuerySeeding::kGrid;
  config.query.max_dice = 0.9;
  config.sampling.even_share = 0.0;
  config.rate = {.semantic_feature = 0.0025,
                 .instance_feature = 0.0025,
                 .decoder = 5e-4,
                 .query_position_m = 0.02,
                 .query_log_sigma = 0.01,
                 .scale = 8.0};
  return config;
}

TEST_F(Heads, TheLiteralSoftmaxIsWorse) {
  PanopticTrainingConfig config = grid_config();
  config.query.variant = renderer::LabelVariant::kLiteral;
  const double literal = scene().evaluate(scene().train("query", config)->result().field).pq;
  EXPECT_LT(literal, 0.85);  // The others reach 0.95.
}

TEST_F(Heads, AllOtherVariantsConverge) {
  PanopticTrainingConfig config = grid_config();
  for (const renderer::LabelVariant variant :
       {renderer::LabelVariant::kNormalised, renderer::LabelVariant::kRaw,
        renderer::LabelVariant::kTemperature, renderer::LabelVariant::kLogSoftmax}) {
    config.query.variant = variant;
    const double pq = scene().evaluate(scene().train("query", config)->result().field).pq;
    EXPECT_GT(pq, 0.9) << static_cast<int>(variant);
  }
}

TEST_F(Heads, BaselinesLearnTheSameScene) {
  const PanopticTrainingConfig config = LabelScene::config();
  const double splatting =
      scene().evaluate(scene().train("panoptic-splatting", config)->result().field).pq;
  const PanopticQuality lifting =
      scene().evaluate(scene().train("panoptic-lifting", config)->result().field);
  EXPECT_GT(splatting, 0.9);
  // Its classes are not tied to instances: stray pixels are segments of their own.
  EXPECT_GT(lifting.pq, 0.5);
  EXPECT_GT(lifting.sq, 0.9);
}

TEST_F(Heads, ClustersOfContrastiveFeaturesAreObjects) {
  PanopticTrainingConfig config = LabelScene::config();
  config.iterations = 600;
  config.contrastive_lift.clustering.min_share = 0.03;  // Of seven objects.
  const PanopticResult result = scene().train("contrastive-lift", config)->result();
  EXPECT_EQ(result.field.instance_id.size(), 7U);
  const PanopticQuality quality = scene().evaluate(result.field);
  // One id for all things, or one for every pixel, has 0.4. As for panoptic-lifting, stray
  // pixels are segments of their own.
  EXPECT_GT(quality.pq, 0.6);
  EXPECT_GT(quality.sq, 0.9);
}

TEST_F(Heads, WithoutTrainingThereAreNoClusters) {
  const PanopticTrainingConfig config = LabelScene::config();
  for (const char* name : {"contrastive-lift", "pvlff"}) {
    const auto head = make_panoptic_head(name, scene().inputs(name, config, 1), config, 1);
    EXPECT_TRUE(head->result().field.instance_id.empty()) << name;
    EXPECT_LT(scene().evaluate(head->result().field).pq, 0.1) << name;
  }
}

TEST_F(Heads, GroupingLearnsIdsThatHoldInAllViews) {
  PanopticTrainingConfig config = LabelScene::config();
  config.association.voxel_m = 0.12;  // Pixels are 3 cm to 8 cm apart.
  const PanopticHeadInputs inputs = scene().inputs("gaussian-grouping", config, 1);
  ASSERT_EQ(inputs.object_of_mask.size(), static_cast<std::size_t>(LabelScene::kViews));
  for (const IdentitySource source :
       {IdentitySource::kAssociated, IdentitySource::kAssigned}) {
    config.gaussian_grouping.identities = source;
    const PanopticResult result = scene().train("gaussian-grouping", config)->result();
    const PanopticQuality quality = scene().evaluate(result.field);
    EXPECT_GT(quality.pq, 0.9) << static_cast<int>(source);
    EXPECT_GT(quality.rq, 0.99) << static_cast<int>(source);
    EXPECT_EQ(result.field.instance_id.size(), result.field.instance_class.size());
  }
}

TEST_F(Heads, WithoutObjectsThereAreClassesAlone) {
  PanopticTrainingConfig config = LabelScene::config();
  config.association.min_voxels = 1'000'000;      // No object is large enough, ...
  config.panoptic_recon.min_surfels = 1'000'000;  // ... nor a patch.
  const PanopticResult result = scene().train("gaussian-grouping", config)->result();
  EXPECT_EQ(result.field.instance_id, std::vector<std::uint16_t>{0});
  EXPECT_TRUE(result.field.instance_class.empty());  // Things are not void.
  EXPECT_GT(scene().evaluate(result.field).pq, 0.3);
  const PanopticResult recon = scene().train("panoptic-recon", config)->result();
  EXPECT_EQ(recon.field.instance_id, std::vector<std::uint16_t>{0});
  EXPECT_TRUE(recon.field.instance_class.empty());
}

TEST_F(Heads, GroupsOfTheCodebookBecomeObjects) {
  PanopticTrainingConfig config = LabelScene::config();
  config.iterations = 300;
  const PanopticResult result = scene().train("open-gaussian", config)->result();
  const PanopticQuality quality = scene().evaluate(result.field);
  EXPECT_GT(quality.pq, 0.9);
  EXPECT_GT(quality.rq, 0.9);
  EXPECT_EQ(result.field.instance_id.size(), 7U);
}

TEST_F(Heads, BeforeThereIsACodebookNothingHasALabel) {
  PanopticTrainingConfig config = LabelScene::config();
  config.iterations = 20;
  config.open_gaussian.coarse_from = 1.0;
  const PanopticResult result = scene().train("open-gaussian", config)->result();
  EXPECT_TRUE(result.field.instance_id.empty());
  EXPECT_EQ(scene().evaluate(result.field).pq, 0.0);
}

TEST_F(Heads, TheGuidanceGraphGivesIdsThatAreLearnt) {
  PanopticTrainingConfig config = LabelScene::config();
  config.panoptic_recon.max_gap_m = 0.12;  // Surfels are 8 cm apart.
  config.panoptic_recon.min_surfels = 4;
  const PanopticHeadInputs inputs = scene().inputs("panoptic-recon", config, 1);
  EXPECT_EQ(inputs.object_class.size(), 7U);
  const PanopticResult result = scene().train("panoptic-recon", config)->result();
  const PanopticQuality quality = scene().evaluate(result.field);
  EXPECT_GT(quality.pq, 0.9);
  EXPECT_GT(quality.rq, 0.99);
}

TEST_F(Heads, QueriesOfPanopticReconPlusFindTheirObjects) {
  PanopticTrainingConfig config = LabelScene::config();
  config.iterations = 300;
  const PanopticResult result = scene().train("panoptic-recon++", config)->result();
  EXPECT_FALSE(result.model.has_value());  // Its decoder is not linear.
  EXPECT_EQ(result.field.instance_id.size(), result.field.instance_class.size());
  // It began with more queries on its grid than there are objects.
  EXPECT_LT(result.field.instance_id.size(),
            scene().inputs("panoptic-recon++", config, 1).query_seeds.size());
  const PanopticQuality quality = scene().evaluate(result.field);
  EXPECT_GT(quality.pq, 0.8);
  EXPECT_GT(quality.rq, 0.8);
}

TEST_F(Heads, ClustersOfAllPixelsAreNamedByTheirClassFeatures) {
  PanopticTrainingConfig config = LabelScene::config();
  config.iterations = 600;
  config.rate.scale = 3.0;
  const PanopticResult result = scene().train("pvlff", config)->result();
  // Seven objects, the floor and the walls, which may be several clusters of their class.
  EXPECT_GE(result.field.instance_id.size(), 9U);
  EXPECT_LE(result.field.instance_id.size(), 13U);
  const PanopticQuality quality = scene().evaluate(result.field);
  EXPECT_GT(quality.pq, 0.9);
  EXPECT_GT(quality.rq, 0.99);
}

TEST_F(Heads, ResumedTrainingIsTheSameTraining) {
  PanopticTrainingConfig config = LabelScene::config();
  config.iterations = 50;
  config.query.prune_every = 0.2;
  config.query.prune_from = 0.1;
  config.loss.panoptic_from = 0.4;
  const fs::path file = fs::path(::testing::TempDir()) / "heads_resume.state";
  for (const std::string& name : panoptic_head_names()) {
    SCOPED_TRACE(name);
    std::vector<double> through, resumed;
    PanopticTrainingRun run{.config = config,
                            .classes = testing::label_scene_classes(),
                            .seed = 3,
                            .on_progress = {},
                            .on_checkpoint = {},
                            .checkpoint_every = 30,
                            .warp = true};
    const PanopticHeadInputs inputs = scene().inputs(name, config, 3);
    const auto first = make_panoptic_head(name, inputs, config, 3);
    run.on_progress = [&](const PanopticProgress& p) {
      through.push_back(p.losses.back().value);
      return true;
    };
    run.on_checkpoint = [&](std::int64_t iteration) {
      if (iteration == 30) first->save(file);
    };
    EXPECT_EQ(train_panoptic(scene(), *first, run), 50);
    const auto second = make_panoptic_head(name, inputs, config, 3);
    second->load(file);
    run.first_iteration = 30;
    run.on_checkpoint = {};
    run.on_progress = [&](const PanopticProgress& p) {
      resumed.push_back(p.losses.back().value);
      return true;
    };
    EXPECT_EQ(train_panoptic(scene(), *second, run), 50);
    ASSERT_EQ(through.size(), 50U);
    ASSERT_EQ(resumed.size(), 20U);
    for (std::size_t i = 0; i < resumed.size(); ++i) EXPECT_EQ(resumed[i], through[30 + i]);
    EXPECT_EQ(first->result().instance_feature, second->result().instance_feature);
    const renderer::PanopticField one = first->result().field, two = second->result().field;
    for (std::size_t s = 0; s < one.size(); s += 7) {
      ASSERT_EQ(one.instances.row(s).size(), two.instances.row(s).size());
      if (one.instances.row(s).empty()) continue;
      EXPECT_EQ(one.instances.row(s)[0].index, two.instances.row(s)[0].index);
      EXPECT_EQ(one.instances.row(s)[0].excess, two.instances.row(s)[0].excess);
    }
  }
  fs::remove(file);
}

TEST_F(Heads, OtherIdsInEveryFrameDoNotMatter) {
  const PanopticTrainingConfig config = LabelScene::config();
  LabelScene& other = scene();
  other.set_masks(99);
  EXPECT_GT(other.evaluate(other.train("query", config)->result().field).pq, 0.93);
}

/// One step on a batch made by hand.
class OneStep : public Heads {
 protected:
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
