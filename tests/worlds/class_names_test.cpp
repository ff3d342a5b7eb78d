#include "worlds/mesh/class_names.h"

#include <gtest/gtest.h>

namespace segsim::worlds {
namespace {

TEST(ClassNames, TheLongestRuleWins) {
  EXPECT_EQ(class_of_model("ChairA_01_003").name, "chair");
  EXPECT_EQ(class_of_model("TVCabinet_01_001").name, "tv stand");
  EXPECT_EQ(class_of_model("TV_02_001").name, "tv");
  EXPECT_EQ(class_of_model("Tablet_01_001").name, "tablet");
  EXPECT_EQ(class_of_model("Tableware_01_001").name, "tableware");
  EXPECT_EQ(class_of_model("DeskPortraitB_01").name, "picture");
  EXPECT_EQ(class_of_model("aws_robomaker_residential_SofaC_01").name, "couch");
}

TEST(ClassNames, StuffIsNoThing) {
  for (const char* name :
       {"HouseWallB_01_001", "FloorB_01_001", "RoomCeiling_01", "Carpet_01"}) {
    EXPECT_FALSE(class_of_model(name).thing) << name;
  }
  EXPECT_TRUE(class_of_model("Wardrobe_01_001").thing);
}

TEST(ClassNames, AClassMayBeWrittenInsideTheName) {
  EXPECT_EQ(class_of_model("living_room_sofa").name, "couch");
  EXPECT_EQ(class_of_model("old-wooden-chair.001").name, "chair");
  EXPECT_EQ(class_of_model("office_desk_lamp").name, "lamp")
      << "the last word says what it is";
}

TEST(ClassNames, PartsOfWordsAreNoClass) {
  EXPECT_NE(class_of_model("PublicBathroomA").name, "bathtub");
  for (const char* name : {"xtvx", "football_pitch", "Benchmark", "bedlam", "Tablecloth"}) {
    EXPECT_FALSE(class_of_model(name).known) << name;
  }
  EXPECT_EQ(class_of_model("benches_2").name, "bench") << "but plurals are";
}

TEST(ClassNames, WordsEndAtCapitalsNumbersAndSigns) {
  using Words = std::vector<std::string>;
  EXPECT_EQ(words_of_name("TVStand_01_003"), (Words{"tv", "stand"}));
  EXPECT_EQ(words_of_name("office-chair_clone_0"), (Words{"office", "chair"}));
  EXPECT_EQ(words_of_name("XRayMachine"), (Words{"ray", "machine"}));
  EXPECT_EQ(words_of_name("_12"), Words{});
}

TEST(ClassNames, AllModelsOfTheSmallHouseAreKnown) {
  for (const char* name :
       {"AirconditionerA", "Ball",         "Bed",        "NightStand",    "Board",
        "RoomCeiling",     "ChairD",       "Chandelier", "Carpet",        "SecurityCamera",
        "CoffeeTable",     "CookingBench", "Curtain",    "KitchenTable",  "ReadingDesk",
        "BalconyTable",    "Door",         "Dumbbell",   "Tablet",        "FitnessEquipment",
        "FoldingDoor",     "Handle",       "HouseWallB", "FloorB",        "KitchenCabinet",
        "KitchenUtensils", "LightC",       "PortraitE",  "DeskPortraitD", "Rangehood",
        "Refrigerator",    "SeasoningBox", "ShoeRack",   "SofaC",         "Tableware",
        "Trash",           "TV",           "TVCabinet",  "Vase",          "RoomWall",
        "Wardrobe",        "RoomWindow",   "Pillow",     "Quilt"}) {
    EXPECT_TRUE(class_of_model(name).known) << name;
  }
}

TEST(LabelTable, IdsFollowTheOrderOfAppearance) {
  sim::MeshScene scene;
  LabelTable labels(scene);
  const auto wall = labels.add("Wall_1");
  const auto chair = labels.add("Chair_1");
  const auto second_chair = labels.add("Chair_2");
  const auto mystery = labels.add("Qwfp_1");
  EXPECT_EQ(wall.class_id, 1);
  EXPECT_EQ(wall.instance_id, 0);
  EXPECT_EQ(chair.class_id, 2);
  EXPECT_EQ(chair.instance_id, 1);
  EXPECT_EQ(second_chair.class_id, 2);
  EXPECT_EQ(second_chair.instance_id, 2);
  EXPECT_EQ(mystery.class_id, 3);
  ASSERT_EQ(scene.classes.size(), 3U);
  EXPECT_EQ(scene.classes[2].name, "unknown");
  EXPECT_FALSE(scene.classes[0].thing);
  ASSERT_EQ(scene.warnings.size(), 1U);
  EXPECT_NE(scene.warnings[0].find("Qwfp_1"), std::string::npos);
}

TEST(LabelTable, BoxesEncloseTheMeshesOfAnInstance) {
  sim::MeshScene scene;
  LabelTable labels(scene);
  const auto chair = labels.add("chair");
  sim::SubMesh mesh;
  mesh.instance_id = chair.instance_id;
  mesh.positions_m = {{1, 2, 3}, {0, 5, 4}};
  scene.meshes.push_back(mesh);
  mesh.positions_m = {{-1, 3, 3}};
  scene.meshes.push_back(mesh);
  set_instance_boxes(scene);
  EXPECT_EQ(scene.instances[0].box_min_m, glm::dvec3(-1, 2, 3));
  EXPECT_EQ(scene.instances[0].box_max_m, glm::dvec3(1, 5, 4));
}

}  // namespace
}  // namespace segsim::worlds
