// Which scenes a detector is tuned on, and where it then runs.
#include "experiments/specs/tuning_set.h"

#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/error_message.h"

namespace segsim::experiments {
namespace {

using specs::ArmDetector;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

/// Scenes a to f, of which those from e on are in the pool "unseen".
std::string spec_text(const std::string& finetune, const std::string& more = "") {
  std::string text = "schema: segsim.experiment/1\nname: six\nscenes:\n";
  for (const char* name : {"a", "b", "c", "d", "e", "f"}) {
    text += std::string("  - {name: ") + name +
            ", bundle: b, goals: [chair], pool: " + (*name < 'e' ? "train" : "unseen") + "}\n";
  }
  return text + "detectors: {finetune: {" + finetune +
         "}}\narms:\n"
         "  - {name: before, detector: before}\n"
         "  - {name: after-here, detector: after-here}\n"
         "  - {name: after-elsewhere, detector: after-elsewhere}\n" +
         more;
}

specs::ExperimentSpec spec_of(const std::string& text) {
  specs::SpecFolders folders;
  return specs::parse_spec(text, "six.yaml", folders);
}

std::string error_of(const std::string& text) {
  return tests::input_error_of([&] { (void)spec_of(text); });
}

specs::TuningSet set_in(const specs::ExperimentSpec& spec, ArmDetector detector,
                        const std::string& scene) {
  return specs::tuning_set(spec, detector, *spec.find_scene(scene));
}

TEST(TuningSet, HereIsTheSceneAlone) {
  const specs::ExperimentSpec spec = spec_of(spec_text("pools: [train]"));
  EXPECT_EQ(set_in(spec, ArmDetector::kAfterHere, "b"), (specs::TuningSet{"here-b", {"b"}}));
  EXPECT_EQ(set_in(spec, ArmDetector::kAfterHere, "f"), (specs::TuningSet{"here-f", {"f"}}));
  EXPECT_EQ(set_in(spec, ArmDetector::kAfter, "f"),
            (specs::TuningSet{"", {"a", "b", "c", "d"}}));
}

TEST(TuningSet, ElsewhereLeavesTheSceneOut) {
  const specs::ExperimentSpec spec = spec_of(spec_text("pools: [train]"));
  EXPECT_EQ(set_in(spec, ArmDetector::kAfterElsewhere, "b"),
            (specs::TuningSet{"without-b", {"a", "c", "d"}}));
  EXPECT_EQ(set_in(spec, ArmDetector::kAfterElsewhere, "e"),
            (specs::TuningSet{"pool", {"a", "b", "c", "d"}}));
  // By default all scenes are the pool.
  EXPECT_EQ(set_in(spec_of(spec_text("steps: 5")), ArmDetector::kAfterElsewhere, "f"),
            (specs::TuningSet{"without-f", {"a", "b", "c", "d", "e"}}));
}

TEST(TuningSet, NoSceneIsInItsOwnFold) {
  for (const int folds : {2, 3, 4}) {
    const specs::ExperimentSpec spec =
        spec_of(spec_text("pools: [train], folds: " + std::to_string(folds)));
    std::set<std::string> names;
    for (const specs::SceneSpec& scene : spec.scenes) {
      const specs::TuningSet set =
          specs::tuning_set(spec, ArmDetector::kAfterElsewhere, scene);
      EXPECT_THAT(set.scenes, Not(testing::Contains(scene.name)));
      EXPECT_THAT(set.scenes, Not(testing::IsEmpty()));
      names.insert(set.name);
    }
    EXPECT_EQ(names.size(), static_cast<std::size_t>(folds) + 1U);  // And the whole pool.
  }
}

TEST(TuningSet, LeakageFollowsFromIt) {
  const specs::ExperimentSpec spec = spec_of(spec_text("pools: [train], folds: 2"));
  for (const specs::SceneSpec& scene : spec.scenes) {
    EXPECT_FALSE(spec.leaks(*spec.find_arm("before"), scene));
    EXPECT_TRUE(spec.leaks(*spec.find_arm("after-here"), scene)) << scene.name;
    EXPECT_FALSE(spec.leaks(*spec.find_arm("after-elsewhere"), scene)) << scene.name;
  }
}

TEST(TuningSet, EveryArmHasAllTrainings) {
  const specs::ExperimentSpec spec =
      spec_of(spec_text("seed: 2", "repetitions: {finetune_seeds: 2}\n"));
  std::vector<std::string> names;
  for (const specs::ArmSpec& arm : spec.arms) names.push_back(arm.name);
  EXPECT_THAT(names, ElementsAre("before", "after-here", "after-here.s3", "after-elsewhere",
                                 "after-elsewhere.s3"));
}

TEST(TuningSet, MistakesAreNamed) {
  EXPECT_THAT(error_of(spec_text("pools: [trian]")), HasSubstr("near: train"));
  EXPECT_THAT(error_of(spec_text("pools: []")), HasSubstr("at least one pool"));
  EXPECT_THAT(error_of(spec_text("pools: [train], scenes: [a]")), HasSubstr("both"));
  EXPECT_THAT(error_of(spec_text("pools: [train], folds: 5")), HasSubstr("[2, 4]"));
  EXPECT_THAT(error_of(spec_text("scenes: [a]")), HasSubstr("two or more scenes"));
  const std::string text = spec_text("seed: 2");
  const std::string none = "detectors: {finetune: {seed: 2}}\n";
  EXPECT_THAT(error_of(std::string(text).erase(text.find(none), none.size())),
              HasSubstr("detectors.finetune"));
}

}  // namespace
}  // namespace segsim::experiments
