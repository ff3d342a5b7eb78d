#include "renderer/scene/panoptic_field.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"
#include "tests/renderer/panoptic_scenes.h"

namespace segsim::renderer {
namespace {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

SurfelCloud cloud_with_features(int count = 300) {
  SurfelCloud cloud = testing::random_scene(5, count);
  testing::add_random_features(cloud, 9);
  return cloud;
}

/// A row as dense probabilities.
std::vector<double> dense_row(const SparseScores& scores, std::size_t surfel,
                              std::size_t size) {
  std::vector<double> p(size, static_cast<double>(scores.base(surfel)));
  for (const SparseScores::Entry& entry : scores.row(surfel)) {
    p[entry.index] += static_cast<double>(entry.excess);
  }
  return p;
}

TEST(PanopticField, KeepingAllIsTheDenseSoftmax) {
  const SurfelCloud cloud = cloud_with_features();
  for (const float temperature : {1.0F, 0.3F, 0.1F, 0.05F}) {
    SCOPED_TRACE(temperature);
    const PanopticModel model = testing::random_model(2, 11, 50, temperature);
    const PanopticField field = fold_panoptic_model(
        cloud, model, {.max_classes = 11, .max_instances = 50, .min_excess = 0.0F});
    double worst = 0.0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const std::vector<double> expected = testing::dense_instances(model, cloud, i);
      const std::vector<double> p = dense_row(field.instances, i, expected.size());
      for (std::size_t q = 0; q < p.size(); ++q) {
        worst = std::max(worst, std::abs(p[q] - expected[q]));
      }
      const std::vector<double> classes = testing::dense_classes(model, cloud, i);
      const std::vector<double> c = dense_row(field.classes, i, classes.size());
      for (std::size_t k = 0; k < c.size(); ++k) {
        worst = std::max(worst, std::abs(c[k] - classes[k]));
      }
    }
    EXPECT_LT(worst, 1e-7);  // Rounding to float.
    EXPECT_LT(field.dropped_instances.max, 1e-6);
    EXPECT_LT(field.dropped_classes.max, 1e-6);
  }
}

TEST(PanopticField, AttentionIsThePapersFormula) {
  const SurfelCloud cloud = cloud_with_features(50);
  const PanopticModel model = testing::random_model(3, 2, 20, 1.0F);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const std::vector<double> a =
        attention(model, cloud.position_m[i], cloud.instance_feature[i]);
    std::vector<double> p;
    double sum = 0.0;
    for (const double value : a) sum += std::exp(value);
    for (const double value : a) p.push_back(std::exp(value) / sum);
    const std::vector<double> expected = testing::dense_instances(model, cloud, i);
    for (std::size_t q = 0; q < p.size(); ++q) EXPECT_NEAR(p[q], expected[q], 1e-9);
  }
}

TEST(PanopticField, AttentionAtAQuerysCentreIsTheSimilarityAlone) {
  PanopticModel model = testing::random_model(4, 0, 1);
  core::InstanceFeature feature{};
  EXPECT_DOUBLE_EQ(attention(model, model.queries[0].position_m, feature)[0], 0.5);
  // One sigma along the query's first axis: exp(-1/2).
  const glm::mat3 R = glm::mat3_cast(model.queries[0].R_world_query);
  const glm::vec3 at = model.queries[0].position_m + model.queries[0].sigma_m.x * R[0];
  EXPECT_NEAR(attention(model, at, feature)[0], 0.5 * std::exp(-0.5), 1e-5);
}

TEST(PanopticField, DroppedMassIsWhatRowsLack) {
  const SurfelCloud cloud = cloud_with_features();
  const PanopticModel model = testing::random_model(6, 12, 60, 0.2F, 1.5);
  const PanopticField field = fold_panoptic_model(
      cloud, model, {.max_classes = 3, .max_instances = 4, .min_excess = 1e-3F});
  DroppedMass classes, instances;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    double lack = 0.0;
    const std::vector<double> expected = testing::dense_instances(model, cloud, i);
    const std::vector<double> p = dense_row(field.instances, i, expected.size());
    for (std::size_t q = 0; q < p.size(); ++q) lack += expected[q] - p[q];
    instances.max = std::max(instances.max, lack);
    instances.mean += lack / static_cast<double>(cloud.size());
    lack = 1.0;
    for (const SparseScores::Entry& entry : field.classes.row(i)) {
      lack -= static_cast<double>(entry.excess);
    }
    classes.max = std::max(classes.max, lack);
    classes.mean += lack / static_cast<double>(cloud.size());
    EXPECT_LE(field.classes.row(i).size(), 3U);
    EXPECT_LE(field.instances.row(i).size(), 4U);
  }
  EXPECT_NEAR(field.dropped_instances.max, instances.max, 1e-6);
  EXPECT_NEAR(field.dropped_instances.mean, instances.mean, 1e-6);
  EXPECT_NEAR(field.dropped_classes.max, classes.max, 1e-6);
  EXPECT_NEAR(field.dropped_classes.mean, classes.mean, 1e-6);
  EXPECT_GT(field.dropped_instances.max, 0.01);  // So that the comparison says something.
  EXPECT_GT(field.dropped_classes.max, 0.01);
}

TEST(PanopticField, RowsHoldTheLargestFirst) {
  const SurfelCloud cloud = cloud_with_features(100);
  const PanopticModel model = testing::random_model(7, 12, 60, 0.2F, 1.5);
  const PanopticField field = fold_panoptic_model(
      cloud, model, {.max_classes = 4, .max_instances = 5, .min_excess = 0.0F});
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    std::vector<double> expected = testing::dense_instances(model, cloud, i);
    std::sort(expected.begin(), expected.end(), std::greater<>());
    const auto row = field.instances.row(i);
    ASSERT_LE(row.size(), 5U);
    for (std::size_t m = 0; m < row.size(); ++m) {
      EXPECT_NEAR(static_cast<double>(field.instances.base(i) + row[m].excess), expected[m],
                  1e-7);
    }
    for (std::size_t m = row.size(); m < 5; ++m) {  // Nothing that fits was left out.
      EXPECT_NEAR(expected[m], static_cast<double>(field.instances.base(i)), 1e-7);
    }
  }
}

TEST(PanopticField, TemperatureDecidesHowSureTheWinnerIs) {
  // N = 50, the surfel at the centre of one query and far from all others: A = 1 and 0.
  SurfelCloud cloud;
  testing::add(cloud, {.position_m = {0.0F, 0.0F, 0.0F}});
  testing::add_random_features(cloud, 1);
  PanopticModel model = testing::random_model(8, 1, 50);
  for (InstanceQuery& q : model.queries) q.position_m = {900.0F, 0.0F, 0.0F};
  model.queries[17].position_m = {0.0F, 0.0F, 0.0F};
  for (std::size_t k = 0; k < 32; ++k) {
    model.queries[17].feature[k] = 10.0F * cloud.instance_feature[0][k];
  }
  const auto winner = [&](float temperature) {
    model.temperature = temperature;
    const PanopticField field = fold_panoptic_model(cloud, model);
    EXPECT_EQ(field.instances.row(0).size(), 1U);
    EXPECT_EQ(field.instances.row(0)[0].index, 17);
    return static_cast<double>(field.instances.base(0) + field.instances.row(0)[0].excess);
  };
  EXPECT_NEAR(winner(1.0F), 0.0526, 5e-5);
  EXPECT_NEAR(winner(0.1F), 0.998, 5e-4);
}

TEST(PanopticField, NormalisedScoresLeaveARestForNone) {
  const SurfelCloud cloud = cloud_with_features();
  PanopticModel model = testing::random_model(2, 4, 30);
  model.none_score = 0.1F;
  for (const LabelVariant variant :
       {LabelVariant::kNormalised, LabelVariant::kLogSoftmax, LabelVariant::kRaw}) {
    SCOPED_TRACE(static_cast<int>(variant));
    model.variant = variant;
    const PanopticField field = fold_panoptic_model(
        cloud, model, {.max_classes = 4, .max_instances = 31, .min_excess = 0.0F});
    ASSERT_EQ(field.instance_id.size(), 31U);
    EXPECT_EQ(field.instance_id[30], 0);
    double far = 0.0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      std::vector<double> a = attention(model, cloud.position_m[i], cloud.instance_feature[i]);
      const auto near = [&] {  // Without what lies beyond four sigma.
        std::vector<double> kept = a;
        for (std::size_t q = 0; q < kept.size(); ++q) {
          PanopticModel one = model;
          one.queries = {model.queries[q]};
          one.queries[0].feature = {};
          const double d2 = -2.0 * std::log(2.0 * attention(one, cloud.position_m[i], {})[0]);
          if (d2 > kAttentionReach2) {
            far = std::max(far, kept[q]);
            kept[q] = 0.0;
          }
        }
        return kept;
      };
      if (variant != LabelVariant::kLogSoftmax) a = near();
      double sum = 0.1;
      for (const double value : a) sum += value;
      if (variant == LabelVariant::kRaw) sum = 1.0;
      const std::vector<double> p = dense_row(field.instances, i, 31);
      for (std::size_t q = 0; q < 30; ++q) EXPECT_NEAR(p[q], a[q] / sum, 1e-6);
      EXPECT_NEAR(p[30], 0.1 / sum, 1e-6);
    }
    EXPECT_LT(far, 3.4e-4);
  }
}

TEST(PanopticField, TheLiteralVariantIsTemperatureOne) {
  const SurfelCloud cloud = cloud_with_features(50);
  PanopticModel literal = testing::random_model(2, 4, 30, 0.1F), one = literal;
  literal.variant = LabelVariant::kLiteral;
  one.temperature = 1.0F;
  const FoldOptions all{.max_classes = 4, .max_instances = 30, .min_excess = 0.0F};
  const PanopticField a = fold_panoptic_model(cloud, literal, all);
  const PanopticField b = fold_panoptic_model(cloud, one, all);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const auto p = dense_row(a.instances, i, 30), q = dense_row(b.instances, i, 30);
    for (std::size_t k = 0; k < 30; ++k) EXPECT_NEAR(p[k], q[k], 1e-7);
  }
}

TEST(PanopticField, QueriesWithClassesShareOutTheThings) {
  const SurfelCloud cloud = cloud_with_features();
  PanopticModel model =
      testing::random_model(2, 5, 12);  // Classes 0 3 6 9 12; 3 and 9 things.
  model.variant = LabelVariant::kNormalised;
  const PanopticField plain = fold_panoptic_model(
      cloud, model, {.max_classes = 5, .max_instances = 13, .min_excess = 0.0F});
  EXPECT_TRUE(plain.instance_class.empty());
  for (std::size_t q = 0; q < 12; ++q) model.queries[q].class_id = q % 3 == 2 ? 0 : 3;
  const PanopticField field = fold_panoptic_model(
      cloud, model, {.max_classes = 5, .max_instances = 13, .min_excess = 0.0F});
  EXPECT_EQ(field.instance_class,
            (std::vector<std::uint16_t>{3, 3, 0, 3, 3, 0, 3, 3, 0, 3, 3, 0, 0}));
  bool moved = false;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const auto before = dense_row(plain.classes, i, 5), after = dense_row(field.classes, i, 5);
    const auto share = dense_row(field.instances, i, 13);
    double claimed = 0.0;
    for (std::size_t q = 0; q < 12; ++q) claimed += q % 3 == 2 ? 0.0 : share[q];
    const double things = before[1] + before[3];
    for (const std::size_t stuff : {0U, 2U, 4U})
      EXPECT_NEAR(after[stuff], before[stuff], 1e-6);
    EXPECT_NEAR(after[1], before[1] * (1.0 - claimed) + things * claimed, 1e-6);
    EXPECT_NEAR(after[3], before[3] * (1.0 - claimed), 1e-6);
    moved |= after[1] > before[1] + 0.1;
  }
  EXPECT_TRUE(moved);
}

TEST(PanopticField, SameForAnyNumberOfThreads) {
  const SurfelCloud cloud = cloud_with_features(5000);
  const PanopticModel model = testing::random_model(9, 8, 30);
  const PanopticField one = fold_panoptic_model(cloud, model, {.threads = 1});
  const PanopticField many = fold_panoptic_model(cloud, model, {.threads = 3});
  EXPECT_EQ(one.dropped_instances.mean, many.dropped_instances.mean);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    EXPECT_EQ(one.instances.base(i), many.instances.base(i));
    ASSERT_EQ(one.instances.row(i).size(), many.instances.row(i).size());
    for (std::size_t m = 0; m < one.instances.row(i).size(); ++m) {
      EXPECT_EQ(one.instances.row(i)[m].index, many.instances.row(i)[m].index);
      EXPECT_EQ(one.instances.row(i)[m].excess, many.instances.row(i)[m].excess);
    }
  }
}

TEST(PanopticField, NothingToFold) {
  const PanopticModel model = testing::random_model(1, 3, 4);
  EXPECT_EQ(fold_panoptic_model(SurfelCloud{}, model).size(), 0U);
  const PanopticField field = fold_panoptic_model(cloud_with_features(3), PanopticModel{});
  EXPECT_EQ(field.size(), 3U);
  EXPECT_TRUE(field.classes.row(2).empty());
  EXPECT_TRUE(field.instances.row(2).empty());
}

TEST(PanopticField, BadModelsAndCloudsAreRefused) {
  const SurfelCloud cloud = cloud_with_features(10);
  const auto expect_refused = [&](const std::function<void(PanopticModel&)>& damage) {
    PanopticModel model = testing::random_model(1, 3, 4);
    damage(model);
    EXPECT_THROW(static_cast<void>(fold_panoptic_model(cloud, model)),
                 core::ContractViolation);
  };
  expect_refused([](PanopticModel& m) { m.temperature = 0.0F; });
  expect_refused([](PanopticModel& m) { m.temperature = std::nanf(""); });
  expect_refused([](PanopticModel& m) { m.classes[1].id = m.classes[0].id; });
  expect_refused([](PanopticModel& m) { m.classes[2].weight[15] = std::nanf(""); });
  expect_refused([](PanopticModel& m) { m.classes[2].bias = INFINITY; });
  expect_refused([](PanopticModel& m) { m.queries[3].id = m.queries[0].id; });
  expect_refused([](PanopticModel& m) { m.queries[0].id = 0; });
  expect_refused([](PanopticModel& m) { m.queries[0].class_id = 6; });   // Stuff.
  expect_refused([](PanopticModel& m) { m.queries[0].class_id = 99; });  // Not there.
  expect_refused([](PanopticModel& m) { m.none_score = -0.1F; });
  expect_refused([](PanopticModel& m) { m.queries[1].sigma_m.y = 0.0F; });
  expect_refused([](PanopticModel& m) { m.queries[1].sigma_m.z = INFINITY; });
  expect_refused([](PanopticModel& m) { m.queries[1].position_m.x = std::nanf(""); });
  expect_refused([](PanopticModel& m) { m.queries[1].R_world_query = {2.0F, 0, 0, 0}; });
  expect_refused([](PanopticModel& m) { m.queries[1].feature[31] = std::nanf(""); });
  const PanopticModel model = testing::random_model(1, 3, 4);
  EXPECT_THROW(static_cast<void>(fold_panoptic_model(testing::random_scene(1, 5), model)),
               core::ContractViolation);
  EXPECT_THROW(static_cast<void>(fold_panoptic_model(cloud, model, {.max_classes = 0})),
               core::ContractViolation);
}

class PanopticFile : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::path(::testing::TempDir()) / (std::string("panoptic_") + info->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    file_ = folder_ / kPanopticFileName;
  }
  void TearDown() override { fs::remove_all(folder_); }

  [[nodiscard]] std::string error_of(const std::string& bytes) const {
    std::ofstream(file_, std::ios::binary) << bytes;
    try {
      static_cast<void>(read_panoptic_model(file_));
    } catch (const core::InputError& error) {
      return error.what();
    }
    return "no error";
  }

  fs::path folder_, file_;
};

TEST_F(PanopticFile, RoundTripIsExact) {
  PanopticModel model = testing::random_model(12, 7, 33, 0.07F);
  model.variant = LabelVariant::kRaw;
  model.none_score = 0.3F;
  model.queries[4].class_id = 9;
  write_panoptic_model(file_, model);
  const PanopticModel read = read_panoptic_model(file_);
  EXPECT_EQ(read.temperature, model.temperature);
  EXPECT_EQ(read.variant, model.variant);
  EXPECT_EQ(read.none_score, model.none_score);
  ASSERT_EQ(read.classes.size(), model.classes.size());
  for (std::size_t c = 0; c < model.classes.size(); ++c) {
    EXPECT_EQ(read.classes[c].id, model.classes[c].id);
    EXPECT_EQ(read.classes[c].thing, model.classes[c].thing);
    EXPECT_EQ(read.classes[c].bias, model.classes[c].bias);
    EXPECT_EQ(read.classes[c].weight, model.classes[c].weight);
  }
  ASSERT_EQ(read.queries.size(), model.queries.size());
  for (std::size_t q = 0; q < model.queries.size(); ++q) {
    EXPECT_EQ(read.queries[q].id, model.queries[q].id);
    EXPECT_EQ(read.queries[q].class_id, model.queries[q].class_id);
    EXPECT_EQ(read.queries[q].position_m, model.queries[q].position_m);
    EXPECT_EQ(read.queries[q].R_world_query, model.queries[q].R_world_query);
    EXPECT_EQ(read.queries[q].sigma_m, model.queries[q].sigma_m);
    EXPECT_EQ(read.queries[q].feature, model.queries[q].feature);
  }
}

TEST_F(PanopticFile, VersionOneIsRead) {
  const PanopticModel model = testing::random_model(12, 7, 33, 0.07F);
  write_panoptic_model(file_, model);
  std::string payload = core::read_file(file_).substr(84);
  payload.erase(12, 8);  // Variant and none-score.
  const std::uint64_t size = payload.size();
  std::string header = core::read_file(file_).substr(0, 20);
  header[8] = 1;
  std::memcpy(header.data() + 12, &size, sizeof size);
  ASSERT_EQ(error_of(header + core::sha256_hex(payload) + payload), "no error");
  const PanopticModel read = read_panoptic_model(file_);
  EXPECT_EQ(read.variant, LabelVariant::kTemperature);
  EXPECT_EQ(read.temperature, 0.07F);
  ASSERT_EQ(read.queries.size(), 33U);
  EXPECT_EQ(read.queries[32].feature, model.queries[32].feature);
}

TEST_F(PanopticFile, LayoutIsTheDocumentedOne) {
  write_panoptic_model(file_, testing::random_model(12, 7, 33));
  const std::string bytes = core::read_file(file_);
  EXPECT_EQ(bytes.size(), 84U + 20U + 7U * (8 + 16 * 4) + 33U * (4 + (3 + 4 + 3 + 32) * 4));
  EXPECT_EQ(bytes.substr(0, 8), "SEGSIMPF");
  EXPECT_EQ(bytes.substr(20, 64), core::sha256_hex(bytes.substr(84)));
}

TEST_F(PanopticFile, DamagedFilesAreRefused) {
  write_panoptic_model(file_, testing::random_model(12, 7, 33));
  const std::string good = core::read_file(file_);
  ASSERT_EQ(error_of(good), "no error");
  for (std::size_t at = 0; at < good.size(); at += 7) {  // Any byte of it.
    std::string damaged = good;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x20);
    EXPECT_NE(error_of(damaged), "no error") << at;
  }
  EXPECT_THAT(error_of(""), HasSubstr("panoptic.bin: expected a panoptic model"));
  EXPECT_THAT(error_of(good.substr(0, 50)), HasSubstr("expected a panoptic model"));
  EXPECT_THAT(error_of(good.substr(0, good.size() - 1)), HasSubstr("bytes of payload, found"));
  EXPECT_THAT(error_of(good + "x"), HasSubstr("bytes of payload, found"));
  std::string version = good;
  version[8] = 3;
  EXPECT_THAT(error_of(version), HasSubstr("expected version 1 or 2, found 3"));
  std::string payload = good;
  payload[200] = static_cast<char>(payload[200] + 1);
  EXPECT_THAT(error_of(payload), HasSubstr("SHA-256"));
  EXPECT_THROW(static_cast<void>(read_panoptic_model(folder_ / "none.bin")), core::InputError);
}

TEST_F(PanopticFile, UnusableValuesWithAGoodHashAreRefused) {
  write_panoptic_model(file_, testing::random_model(12, 7, 33));
  const std::string good = core::read_file(file_);
  const auto with = [&](std::size_t at, const std::string& value) {
    std::string payload = good.substr(84);
    payload.replace(at, value.size(), value);
    return error_of(good.substr(0, 20) + core::sha256_hex(payload) + payload);
  };
  EXPECT_THAT(with(0, std::string(4, '\0')), HasSubstr("temperature"));
  EXPECT_THAT(with(12, "\x05"), HasSubstr("expected a label variant 0 to 4, found 5"));
  EXPECT_THAT(with(22, "\x02"), HasSubstr("expected thing 0 or 1, found 2"));
  // A count that is too large runs into the end; one that is too small leaves a rest.
  EXPECT_THAT(with(8, "\xFF\xFF\xFF\xFF"), HasSubstr("found its end"));
  EXPECT_THAT(with(8, "\x20"), HasSubstr("bytes of payload"));
}

TEST_F(PanopticFile, BrokenModelsAreNotWritten) {
  PanopticModel model = testing::random_model(12, 7, 33);
  model.temperature = -1.0F;
  EXPECT_THROW(write_panoptic_model(file_, model), core::ContractViolation);
  EXPECT_FALSE(fs::exists(file_));
}

}  // namespace
}  // namespace segsim::renderer
