#include "renderer/files/label_edits.h"

#include <algorithm>
#include <fstream>
#include <map>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/file_io.h"
#include "renderer/raster/label_resolve.h"
#include "tests/error_message.h"
#include "tests/renderer/panoptic_scenes.h"
#include "tests/temporary_folder.h"

namespace segsim::renderer {
namespace {

using ::testing::HasSubstr;
using tests::input_error_of;
using tests::TemporaryFolder;

constexpr std::size_t kSurfels = 400;

SurfelCloud labelled_cloud() {
  SurfelCloud cloud = testing::random_scene(5, kSurfels);
  testing::add_random_features(cloud, 9);
  cloud.semantic_id.assign(kSurfels, 3);
  cloud.instance_id.assign(kSurfels, 7);
  return cloud;
}

PanopticField random_field(const SurfelCloud& cloud, LabelVariant variant, bool with_classes) {
  PanopticModel model = testing::random_model(2, 6, 12, 0.3F);
  model.variant = variant;
  if (with_classes) {
    for (std::size_t q = 0; q < model.queries.size(); ++q) {
      model.queries[q].class_id = q % 2 == 0 ? 3 : 9;
    }
  }
  return fold_panoptic_model(cloud, model);
}

/// What a surfel says by itself.
std::pair<int, int> label_of(const PanopticField& field, std::size_t surfel) {
  internal::ResolveScratch scratch;
  const internal::WeightedSurfel alone{1.0F, static_cast<std::uint32_t>(surfel)};
  const internal::PixelLabel label = internal::resolve_panoptic(field, {&alone, 1}, scratch);
  return {label.semantic, label.instance};
}

/// Shares above the base by id.
std::map<int, double> shares(const SparseScores& scores, const std::vector<std::uint16_t>& ids,
                             std::size_t surfel) {
  std::map<int, double> by_id;
  for (const auto& entry : scores.row(surfel)) by_id[ids[entry.index]] += entry.excess;
  return by_id;
}

const LabelEdits& some_edits() {
  static const LabelEdits edits{
      // A class and an instance that the field has, new ones, stuff, void.
      {{10, 20, 9, 9}, {40, 5, 77, 300}, {50, 3, 6, 0}, {60, 2, 0, 0}, {399, 1, 9, 9}},
      {{7, 9}, {11, 0}, {300, 13}}};
  return edits;
}

class FieldEdits : public ::testing::TestWithParam<std::pair<LabelVariant, bool>> {};

TEST_P(FieldEdits, SurfelsInRunsAreCertainAndOthersMoveTheirSharesOnly) {
  const auto [variant, with_classes] = GetParam();
  SurfelCloud cloud = labelled_cloud();
  const PanopticField before = random_field(cloud, variant, with_classes);
  PanopticField after = before;
  apply_label_edits(some_edits(), cloud, &after);

  std::vector<const LabelEdits::Run*> run_of(kSurfels, nullptr);
  for (const LabelEdits::Run& run : some_edits().runs) {
    for (std::size_t s = run.first; s < run.first + run.count; ++s) run_of[s] = &run;
  }
  std::size_t moved = 0;
  for (std::size_t s = 0; s < kSurfels; ++s) {
    const std::map<int, double> classes = shares(after.classes, after.class_id, s);
    const std::map<int, double> instances = shares(after.instances, after.instance_id, s);
    if (const LabelEdits::Run* run = run_of[s]) {
      EXPECT_EQ(label_of(after, s), std::pair(int{run->class_id}, int{run->instance_id}));
      EXPECT_EQ(classes, (std::map<int, double>{{run->class_id, 1.0}}));
      if (run->instance_id != 0) {
        EXPECT_EQ(instances, (std::map<int, double>{{run->instance_id, 1.0}}));
      }
      EXPECT_EQ(after.classes.base(s), 0.0F);
      EXPECT_EQ(after.instances.base(s), 0.0F);
      EXPECT_EQ(cloud.semantic_id[s], run->class_id);
      EXPECT_EQ(cloud.instance_id[s], run->instance_id);
      continue;
    }
    EXPECT_EQ(cloud.semantic_id[s], 3);
    EXPECT_EQ(cloud.instance_id[s], 7);
    EXPECT_EQ(classes, shares(before.classes, before.class_id, s));
    std::map<int, double> expected;
    for (const auto& [id, share] : shares(before.instances, before.instance_id, s)) {
      moved += id == 7 || id == 11 ? 1 : 0;
      if (id != 11) expected[id == 7 ? 9 : id] += share;
    }
    ASSERT_EQ(instances.size(), expected.size()) << s;
    for (const auto& [id, share] : expected) EXPECT_NEAR(instances.at(id), share, 1e-6) << s;
    EXPECT_EQ(after.instances.base(s), before.instances.base(s));
    const auto row = after.instances.row(s);
    EXPECT_TRUE(std::is_sorted(row.begin(), row.end(), [](const auto& a, const auto& b) {
      return a.excess > b.excess;
    }));
  }
  EXPECT_GT(moved, 5U);
  if (with_classes) {
    const auto at = [&](int id) {
      return after.instance_class[static_cast<std::size_t>(
          std::find(after.instance_id.begin(), after.instance_id.end(), id) -
          after.instance_id.begin())];
    };
    EXPECT_EQ(at(9), 9);     // It was 3.
    EXPECT_EQ(at(300), 77);  // It was not there.
  } else {
    EXPECT_TRUE(after.instance_class.empty());
  }
}
INSTANTIATE_TEST_SUITE_P(All, FieldEdits,
                         ::testing::Values(std::pair(LabelVariant::kTemperature, false),
                                           std::pair(LabelVariant::kTemperature, true),
                                           std::pair(LabelVariant::kNormalised, false),
                                           std::pair(LabelVariant::kNormalised, true),
                                           std::pair(LabelVariant::kRaw, true)));

TEST(LabelEdits, AFieldWithoutQueriesTakesAnInstance) {
  SurfelCloud cloud = labelled_cloud();
  PanopticModel model = testing::random_model(2, 6, 0);
  PanopticField field = fold_panoptic_model(cloud, model);
  EXPECT_EQ(field.instances.row_capacity(), 0U);
  apply_label_edits({{{5, 2, 9, 4}}, {}}, cloud, &field);
  EXPECT_EQ(label_of(field, 5), std::pair(9, 4));
  EXPECT_EQ(label_of(field, 4).second, 0);
}

TEST(LabelEdits, NoEditsChangeNothing) {
  SurfelCloud cloud = labelled_cloud();
  PanopticField field = random_field(cloud, LabelVariant::kTemperature, false);
  const std::size_t ids = field.instance_id.size();
  apply_label_edits({}, cloud, &field);
  EXPECT_EQ(field.instance_id.size(), ids);
  EXPECT_EQ(cloud.semantic_id, labelled_cloud().semantic_id);
}

class LabelEditsFile : public ::testing::Test {
 protected:
  [[nodiscard]] std::filesystem::path file() const { return folder_ / "label_edits.bin"; }
  [[nodiscard]] std::string refusal(std::size_t surfels = kSurfels) const {
    return input_error_of([&] { static_cast<void>(read_label_edits(file(), surfels)); });
  }
  TemporaryFolder folder_;
};

TEST_F(LabelEditsFile, ComesBack) {
  write_label_edits(file(), some_edits(), kSurfels);
  EXPECT_EQ(read_label_edits(file(), kSurfels), some_edits());
  write_label_edits(file(), {}, 0);
  EXPECT_TRUE(read_label_edits(file(), 0).empty());
}

TEST_F(LabelEditsFile, DamageIsSaid) {
  EXPECT_THAT(refusal(), HasSubstr("label_edits.bin"));
  write_label_edits(file(), some_edits(), kSurfels);
  EXPECT_THAT(refusal(kSurfels + 1), HasSubstr("expected labels of 401 surfels, found 400"));
  std::string bytes = core::read_file(file());
  bytes[bytes.size() - 3] ^= 1;
  std::ofstream(file(), std::ios::binary) << bytes;
  EXPECT_THAT(refusal(), HasSubstr("SHA-256"));
  std::ofstream(file(), std::ios::binary) << bytes.substr(0, bytes.size() - 1);
  EXPECT_THAT(refusal(), HasSubstr("bytes of payload"));
}

TEST_F(LabelEditsFile, OnlyOrderedRunsAndMovesAreRead) {
  const auto refused = [&](const LabelEdits& edits) {
    write_label_edits(file(), edits, kSurfels);
    return refusal();
  };
  EXPECT_EQ(refused({{{0, 400, 1, 1}}, {{1, 2}}}), "no error");
  EXPECT_THAT(refused({{{0, 401, 1, 1}}, {}}), HasSubstr("runs of 400 surfels"));
  EXPECT_THAT(refused({{{4, 0, 1, 1}}, {}}), HasSubstr("found one of 0 from 4"));
  EXPECT_THAT(refused({{{4, 2, 1, 1}, {5, 1, 1, 1}}, {}}), HasSubstr("one of 1 from 5"));
  EXPECT_THAT(refused({{{4294967295U, 4294967295U, 1, 1}}, {}}), HasSubstr("ascending"));
  EXPECT_THAT(refused({{}, {{0, 1}}}), HasSubstr("moves"));
  EXPECT_THAT(refused({{}, {{2, 1}, {2, 3}}}), HasSubstr("2 after 2"));
}

}  // namespace
}  // namespace segsim::renderer
