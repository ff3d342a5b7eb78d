#include <filesystem>
#include <string>

#include <gmock/gmock.h>

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

}  // namespace
}  // namespace segsim::reconstruction
