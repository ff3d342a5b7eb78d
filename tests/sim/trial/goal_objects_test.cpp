#include "sim/trial/goal_objects.h"

#include <gtest/gtest.h>

namespace segsim::sim {
namespace {

core::SceneManifest two_chairs() {
  core::SceneManifest manifest;
  manifest.classes = {{1, "floor", false}, {4, "chair", true}, {5, "couch", true}};
  manifest.instances = {{7, 4, "red"}, {8, 4, "blue"}, {9, 5, "couch"}};
  return manifest;
}

TEST(GoalObjects, AClassIsAllOfItsObjects) {
  const GoalObjects chairs(two_chairs(), "chair");
  EXPECT_FALSE(chairs.empty());
  EXPECT_TRUE(chairs.holds(4, 7));
  EXPECT_TRUE(chairs.holds(4, 8));
  EXPECT_TRUE(chairs.holds(4, 0)) << "pixels of the class that belong to no object count";
  EXPECT_FALSE(chairs.holds(5, 9));
  const GoalObjects beds(two_chairs(), "bed");
  EXPECT_TRUE(beds.empty());
  EXPECT_FALSE(beds.holds(0, 0)) << "void is no goal";
}

TEST(GoalObjects, APhraseIsItsThingsAlone) {
  Episode episode;
  episode.class_name = "chair";
  episode.phrase = "a blue chair";
  episode.goal_instances = {8};
  const core::SceneManifest manifest = two_chairs();
  const GoalObjects goal(manifest, episode);
  EXPECT_FALSE(goal.holds(manifest.instances[0]));
  EXPECT_TRUE(goal.holds(manifest.instances[1]));
  EXPECT_FALSE(goal.holds(4, 0));
  EXPECT_FALSE(goal.holds(5, 8)) << "pixels of another class";
}

TEST(GoalObjects, NamesOfGoals) {
  EXPECT_EQ(with_article("couch"), "a couch");
  EXPECT_EQ(with_article("a red chair"), "a red chair");
  EXPECT_EQ(with_article("the one by the door"), "the one by the door");
  EXPECT_EQ(phrase_word("A red chair!"), "a-red-chair");
  EXPECT_EQ(phrase_word("../x / y"), "x-y");
  EXPECT_EQ(phrase_word("Stuhl f\u00fcr 2"), "stuhl-f\u00fcr-2");
  EXPECT_EQ(phrase_word("?!"), "");
}

}  // namespace
}  // namespace segsim::sim
