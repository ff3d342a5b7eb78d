// What a suite stands for: the spec that is written out of it.
#include "experiments/suites/suite.h"

#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/config.h"
#include "core/error.h"
#include "experiments/specs/spec.h"
#include "experiments/suites/layered_yaml.h"
#include "tests/error_message.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

constexpr const char* kSuite = R"(
schema: segsim.suite/1
name: two-v1
title: "Two homes: here, elsewhere"
about: Two.
scene:
  source: {type: flat, voxel_m: 0.04, capture: {frames: 30, width: 160}}
  goals: [chair, dining table]
  episodes: 3
pools:
  - name: train
    scene: {source: {voxel_m: 0.05}}
    scenes:
      - {name: a, source: {seed: 1}}
      - {name: b, title: B, source: {seed: 2, capture: {frames: 40}}, goals: [bed]}
  - name: unseen
    scenes:
      - {name: c, source: {seed: 3}, episodes: 9}
experiment:
  seed: 5
  detectors: {before: "${spec}/../w.bin", finetune: {pools: [train]}}
  arms:
    - {name: before, detector: before}
    - {name: after-elsewhere, detector: after-elsewhere}
)";

suites::Suite suite_of(const std::string& text) {
  return suites::parse_suite(text, "suites/two-v1.yaml");
}

std::string changed(const std::string& from, const std::string& to) {
  std::string text = kSuite;
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST(Suite, IsWrittenOutAsASpec) {
  const suites::Suite suite = suite_of(kSuite);
  EXPECT_EQ(suite.spec_text,
            R"(schema: segsim.experiment/1
name: two-v1
title: "Two homes: here, elsewhere"
scenes:
  - {name: a, pool: train, source: {type: flat, voxel_m: 0.05, capture: {frames: 30, width: 160}, seed: 1}, goals: [chair, "dining table"], episodes: 3}
  - {name: b, pool: train, source: {type: flat, voxel_m: 0.05, capture: {frames: 40, width: 160}, seed: 2}, goals: [bed], episodes: 3, title: B}
  - {name: c, pool: unseen, source: {type: flat, voxel_m: 0.04, capture: {frames: 30, width: 160}, seed: 3}, goals: [chair, "dining table"], episodes: 9}
seed: 5
detectors: {before: "${spec}/../w.bin", finetune: {pools: [train]}}
arms:
  - {name: before, detector: before}
  - {name: after-elsewhere, detector: after-elsewhere}
)");
  ASSERT_EQ(suite.scenes.size(), 3U);
  EXPECT_EQ(suite.scenes[1].title, "B");
  EXPECT_EQ(suite.scenes[2].pool, "unseen");
  EXPECT_EQ(suite.scenes[2].episodes, 9);
  EXPECT_THAT(suite.arms, ElementsAre("before", "after-elsewhere"));
}

TEST(Suite, ItsSpecIsReadAsAnyOther) {
  const suites::Suite suite = suite_of(kSuite);
  specs::SpecFolders folders;
  const specs::ExperimentSpec spec =
      specs::parse_spec(suite.spec_text, suite.spec_origin(), folders);
  EXPECT_EQ(folders.work, "out/two-v1");
  EXPECT_EQ(spec.sha256, suite.sha256());  // There are no budgets beside it.
  EXPECT_EQ(spec.detectors.before, "w.bin");
  EXPECT_THAT(spec.detectors.finetune->scenes, ElementsAre("a", "b"));
  EXPECT_EQ(spec.scenes[1].source->capture.frames, 40);
  EXPECT_EQ(spec.scenes[2].pool, "unseen");
}

TEST(Suite, TheHashIsOfWhatItStandsForAndNotOfHowItIsWritten) {
  const std::string hash = suite_of(kSuite).sha256();
  EXPECT_EQ(suite_of("# A remark.\n" + std::string(kSuite)).sha256(), hash);
  EXPECT_EQ(suite_of(changed("about: Two.", "about: Two homes.")).sha256(), hash);
  EXPECT_NE(suite_of(changed("seed: 5", "seed: 6")).sha256(), hash);
  EXPECT_NE(suite_of(changed("voxel_m: 0.05", "voxel_m: 0.06")).sha256(), hash);
}

TEST(Suite, MistakesAreNamed) {
  const auto error = [](const std::string& text) {
    return tests::input_error_of([&] { (void)suite_of(text); });
  };
  EXPECT_THAT(error(changed("name: two-v1", "name: two-v2")), HasSubstr("two-v1"));
  EXPECT_THAT(error(changed("segsim.suite/1", "segsim.suite/9")), HasSubstr("segsim.suite/1"));
  EXPECT_THAT(error(changed("about: Two.", "abuot: Two.")), HasSubstr("about"));
  EXPECT_THAT(error(changed("{name: c,", "{name: c, pool: x,")), HasSubstr("pool"));
  EXPECT_THAT(error(changed("  seed: 5", "  title: T")), HasSubstr("the suite has it"));
  EXPECT_THAT(error(changed("  - name: unseen\n", "  - name: unseen\n    furniture: x\n")),
              HasSubstr("furniture"));
  EXPECT_THAT(tests::input_error_of([] { (void)suites::load_suite("no-such-suite"); }),
              testing::AllOf(HasSubstr("suite: expected "), HasSubstr("no-such-suite")));
}

TEST(Suite, ScalarsThatYamlWouldTakeApartAreQuoted) {
  for (const char* plain : {"chair", "-1.53", "a/b.yaml", "true", "20260101"}) {
    EXPECT_EQ(suites::yaml_scalar(plain), plain);
  }
  for (const char* text :
       {"", "-", "null", "a: b", "a, b", "{x}", "say \"no\"", "a\\b", "#1"}) {
    const std::string quoted = suites::yaml_scalar(text);
    EXPECT_EQ(quoted.front(), '"') << text;
    const auto root = core::ConfigNode::parse("key: [" + quoted + "]", "test");
    EXPECT_EQ(root.texts("key").front(), text);
  }
}

/// Those that come with the program are specs without a mistake.
TEST(Suite, ThoseOfTheProgramAreWhole) {
  std::set<std::string> names;
  for (const fs::directory_entry& entry : fs::directory_iterator(SEGSIM_SUITES)) {
    if (entry.path().extension() != ".yaml") continue;
    const suites::Suite suite = suites::load_suite(entry.path().string());
    names.insert(suite.name);
    specs::SpecFolders folders{"/data", ""};
    const specs::ExperimentSpec spec =
        specs::parse_spec(suite.spec_text, suite.spec_origin(), folders);
    EXPECT_TRUE(fs::exists(spec.detectors.before)) << spec.detectors.before;
    for (const specs::SceneSpec& scene : spec.scenes) {
      EXPECT_GE(scene.episodes, 30) << scene.name;
      EXPECT_FALSE(scene.pool.empty()) << scene.name;
    }
    const bool needs_data = suite.spec_text.find("${data}") != std::string::npos;
    EXPECT_EQ(suite.data.empty(), !needs_data) << suite.name;
    EXPECT_THAT(suite.about, Not(testing::IsEmpty()));
  }
  EXPECT_THAT(names, testing::IsSupersetOf({"homes-v1", "places-v1"}));
}

}  // namespace
}  // namespace segsim::experiments
