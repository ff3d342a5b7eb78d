#include "experiments/episodes/habitat_episodes.h"

#include <array>
#include <cmath>
#include <cstdlib>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "experiments/support/gzip_file.h"
#include "renderer/cpu_renderer.h"
#include "tests/experiments/tiny_scene.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using testing::HasSubstr;

constexpr double kPi = std::numbers::pi;

TEST(HabitatFrames, AxesAndHeadings) {
  EXPECT_EQ(episodes::source_from_habitat({1, 2, 3}), glm::dvec3(1, -3, 2));
  EXPECT_EQ(episodes::habitat_from_source(episodes::source_from_habitat({1, 2, 3})),
            glm::dvec3(1, 2, 3));
  // Unturned, the agent looks along -z of Habitat, which is +y here.
  EXPECT_NEAR(episodes::yaw_from_habitat({1, 0, 0, 0}), kPi / 2, 1e-12);
  // A quarter turn about +y (left): -x.
  const double h = std::sqrt(0.5);
  EXPECT_NEAR(std::abs(episodes::yaw_from_habitat({h, 0, h, 0})), kPi, 1e-12);
  // To the right: +x.
  EXPECT_NEAR(episodes::yaw_from_habitat({h, 0, -h, 0}), 0.0, 1e-12);
  for (double yaw = -3.0; yaw < 3.1; yaw += 0.37) {
    EXPECT_NEAR(episodes::yaw_from_habitat(episodes::habitat_from_yaw(yaw)), yaw, 1e-12);
  }
}

TEST(HabitatFrames, TurningIsTheSameInBothFrames) {
  // A step forward in Habitat and the same step here end at the same place.
  const glm::dquat R = episodes::habitat_from_yaw(0.7);
  const glm::dvec3 step_habitat = R * glm::dvec3(0, 0, -1);
  const glm::dvec3 step = episodes::source_from_habitat(step_habitat);
  EXPECT_NEAR(step.x, std::cos(0.7), 1e-12);
  EXPECT_NEAR(step.y, std::sin(0.7), 1e-12);
  EXPECT_NEAR(step.z, 0.0, 1e-12);
}

TEST(HabitatNames, GoalsOfHm3d) {
  const std::pair<const char*, const char*> words[] = {
      {"chair", "chair"},   {"bed", "bed"},       {"plant", "potted plant"},
      {"toilet", "toilet"}, {"tv_monitor", "tv"}, {"sofa", "couch"}};
  for (const auto& [habitat, ours] : words) {
    EXPECT_EQ(episodes::class_of_habitat_category(habitat), ours);
    EXPECT_EQ(episodes::habitat_category_of_class(ours), habitat);
  }
  EXPECT_EQ(episodes::habitat_category_of_class("dining table"), "dining_table");
  EXPECT_EQ(episodes::class_of_habitat_category("dining_table"), "dining table");
}

/// A set of one scene with a chair, its view point and one episode.
Json small_content() {
  const Json point{{"agent_state", {{"position", {0, 0, -2}}, {"rotation", {0, 0, 0, 1}}}},
                   {"iou", 0.3}};
  const Json goal{{"position", {0, 0.5, -3}},
                  {"object_id", 12},
                  {"object_name", "chair_12"},
                  {"view_points", {point}}};
  const Json episode{{"episode_id", "7"},
                     {"scene_id", "a/b/Room.basis.glb"},
                     {"object_category", "chair"},
                     {"start_position", {1, 0.1, 2}},
                     {"start_rotation", {0, 0, 0, 1}},
                     {"info", {{"geodesic_distance", 4.2}, {"euclidean_distance", 4.1}}}};
  return {{"episodes", {episode}}, {"goals_by_category", {{"Room.basis.glb_chair", {goal}}}}};
}

class HabitatFileTest : public testing::Test {
 protected:
  void put(const Json& json) const { support::write_gzip(file_, json.dump()); }
  [[nodiscard]] std::string refusal() const {
    try {
      (void)episodes::read_habitat(file_);
    } catch (const core::InputError& error) {
      return error.what();
    }
    return {};
  }
  TemporaryFolder folder_{"habitat"};
  fs::path file_ = folder_.path() / "val.json.gz";
};

TEST_F(HabitatFileTest, ReadsOneScene) {
  put(small_content());
  const episodes::HabitatDataset dataset = episodes::read_habitat(file_);
  EXPECT_EQ(dataset.split, "val");
  ASSERT_EQ(dataset.scenes.size(), 1U);
  const episodes::HabitatScene& scene = dataset.scenes[0];
  EXPECT_EQ(scene.name, "Room");
  EXPECT_EQ(scene.scene_id, "a/b/Room.basis.glb");
  ASSERT_EQ(scene.episodes.size(), 1U);
  EXPECT_EQ(scene.goals.at("chair").at(0).object_id, 12);
  EXPECT_DOUBLE_EQ(*scene.episodes[0].geodesic_m, 4.2);

  episodes::HabitatImportCounts counts;
  const episodes::EpisodeSet set =
      episodes::episodes_from_habitat(scene, "val", std::nullopt, 1, &counts);
  ASSERT_EQ(set.episodes.size(), 1U);
  const sim::Episode& episode = set.episodes[0];
  EXPECT_EQ(episode.id, "Room/chair/0000");
  EXPECT_DOUBLE_EQ(episode.start.x_m, 1.0);
  EXPECT_DOUBLE_EQ(episode.start.y_m, -2.0);
  EXPECT_NEAR(episode.start.yaw_rad, kPi / 2, 1e-12);
  EXPECT_EQ(episode.view_points_m, std::vector<glm::dvec2>{glm::dvec2(0, 2)});
  EXPECT_DOUBLE_EQ(episode.shortest_path_m, 4.2);
  EXPECT_THAT(episode.source, HasSubstr("val/Room#0 id 7 sha256 "));
  EXPECT_EQ(set.scene_sha256, "");
  EXPECT_EQ(counts.view_points, 1);
}

TEST_F(HabitatFileTest, ViewPointsOfAnotherFloorAreLeftOut) {
  Json content = small_content();
  content["episodes"][0]["start_position"] = {1, 3.0, 2};
  put(content);
  episodes::HabitatImportCounts counts;
  const episodes::EpisodeSet set = episodes::episodes_from_habitat(
      episodes::read_habitat(file_).scenes[0], "val", std::nullopt, 1, &counts);
  EXPECT_EQ(counts.other_floor, 1);
  EXPECT_EQ(counts.view_points_of_other_floors, 1);
  EXPECT_FALSE(std::isfinite(set.episodes[0].shortest_path_m));
  // Such an episode survives the file, so that a run can count it.
  episodes::write_episodes(folder_.path() / "set.jsonl", set);
  const episodes::EpisodeSet again = episodes::read_episodes(folder_.path() / "set.jsonl");
  EXPECT_FALSE(std::isfinite(again.episodes[0].shortest_path_m));
  EXPECT_TRUE(again.episodes[0].view_points_m.empty());
}

/// Two chairs on the ground floor, one upstairs; a bed that no start's floor has.
Json content_of_two_floors() {
  const auto goal = [](int id, const std::vector<double>& heights_m) {
    Json points = Json::array();
    for (const double y_m : heights_m) {
      const Json state{{"position", {0.1 * id, y_m, -2}}, {"rotation", {0, 0, 0, 1}}};
      points.push_back({{"agent_state", state}, {"iou", 0.01 * id}});
    }
    return Json{{"position", {0, 0.5, -3}}, {"object_id", id}, {"view_points", points}};
  };
  Json content = small_content();
  content["goals_by_category"] = {
      {"Room.basis.glb_chair",
       {goal(1, {0.0, 0.5, 3.0}), goal(2, {3.2, -0.4, 0.1}), goal(3, {9.0})}},
      {"Room.basis.glb_bed", {goal(4, {6.0, 6.1})}}};
  const Json episode = content["episodes"][0];
  content["episodes"] = Json::array();
  for (const auto& [category, y_m] :
       {std::pair("chair", 0.1), std::pair("chair", 0.0), std::pair("chair", 3.1),
        std::pair("chair", 0.1), std::pair("bed", 0.0), std::pair("bed", 0.1)}) {
    Json next = episode;
    next["object_category"] = category;
    next["start_position"] = {1, y_m, 2};
    content["episodes"].push_back(next);
  }
  return content;
}

TEST_F(HabitatFileTest, ViewPointsAreCountedOncePerGoal) {
  put(content_of_two_floors());
  episodes::HabitatImportCounts counts;
  const episodes::EpisodeSet set = episodes::episodes_from_habitat(
      episodes::read_habitat(file_).scenes[0], "val", std::nullopt, 1, &counts);
  EXPECT_EQ(counts.episodes, 6);
  EXPECT_EQ(counts.view_points, 9);                  // 3 + 3 + 1 of chairs, 2 of the bed.
  EXPECT_EQ(counts.view_points_of_other_floors, 3);  // At 9.0 m, and both of the bed.
  EXPECT_EQ(counts.other_floor, 2);
  EXPECT_EQ(counts.goal_sets, 2);  // The chairs of either floor.
  // In the file's order, whichever episode asked first.
  const std::vector<std::uint16_t> ground{1, 1, 2, 2}, upstairs{1, 2};
  for (const std::size_t k : {0U, 1U, 3U}) {
    EXPECT_EQ(set.episodes[k].view_point_instance, ground);
    EXPECT_EQ(set.episodes[k].view_points_m[2], glm::dvec2(0.2, 2.0));
    EXPECT_EQ(set.episodes[k].view_point_iou[2], 0.02F);
  }
  EXPECT_EQ(set.episodes[2].view_point_instance, upstairs);
  EXPECT_TRUE(set.episodes[4].view_points_m.empty());
}

TEST_F(HabitatFileTest, OlderFilesKeepGoalsInEpisodes) {
  Json content = small_content();
  content["episodes"][0]["goals"] = content["goals_by_category"]["Room.basis.glb_chair"];
  content.erase("goals_by_category");
  put(content);
  EXPECT_EQ(episodes::read_habitat(file_).scenes[0].goals.at("chair").size(), 1U);
}

/// As in HM3D-OVON: names for ids, and a category that children satisfy.
TEST_F(HabitatFileTest, ChildrenOfACategoryAreGoalsToo) {
  Json content = small_content();
  Json armchair = content["goals_by_category"]["Room.basis.glb_chair"][0];
  armchair["object_id"] = "armchair_31";
  content["goals_by_category"]["Room.basis.glb_armchair"] = {armchair};
  content["goals_by_category"]["Room.basis.glb_chair"][0]["object_id"] = "chair_12";
  content["episodes"][0]["children_object_categories"] = {"armchair", "throne"};
  put(content);
  const episodes::HabitatScene scene = episodes::read_habitat(file_).scenes.at(0);
  const std::vector<episodes::HabitatGoal>& goals = scene.goals.at("chair");
  ASSERT_EQ(goals.size(), 2U) << "no throne is in the file";
  EXPECT_EQ(goals[0].object_id, 12);
  EXPECT_EQ(goals[1].object_id, 31);
  content["goals_by_category"]["Room.basis.glb_chair"][0]["object_id"] = "chair";
  put(content);
  EXPECT_THAT(refusal(), HasSubstr("an object_id has no number"));
}

/// As in GOAT-Bench: an episode is a list of tasks, and `goals` stands for goals_by_category.
TEST_F(HabitatFileTest, TasksThatNameACategoryAreEpisodes) {
  Json content = small_content();
  Json& goals = content["goals"] = content["goals_by_category"];
  content.erase("goals_by_category");
  Json sofa = goals["Room.basis.glb_chair"][0];
  sofa["object_id"] = "sofa_3";
  sofa["children_object_categories"] = {"chair"};
  sofa["lang_desc"] = "a red sofa";
  goals["Room.basis.glb_sofa"] = {sofa};
  Json& episode = content["episodes"][0];
  episode.erase("object_category");
  episode["tasks"] = Json::array({Json::array({"chair", "object", nullptr}),
                                  Json::array({"sofa", "description", "sofa_3"}),
                                  Json::array({"sofa", "object", nullptr}),
                                  Json::array({"chair", "image", "chair_12", 0})});
  put(content);
  const episodes::HabitatScene scene = episodes::read_habitat(file_).scenes.at(0);
  EXPECT_EQ(scene.other_tasks, 2);
  ASSERT_EQ(scene.episodes.size(), 2U);
  EXPECT_EQ(scene.episodes[0].episode_id, "7/0");
  EXPECT_EQ(scene.episodes[1].episode_id, "7/2");
  EXPECT_EQ(scene.episodes[1].index, 1);
  EXPECT_FALSE(scene.episodes[1].geodesic_m.has_value()) << "the file's is that of the list";
  EXPECT_EQ(scene.goals.at("sofa").size(), 2U) << "a chair is a child of a sofa here";
  const episodes::EpisodeSet set =
      episodes::episodes_from_habitat(scene, "val", std::nullopt, 1);
  EXPECT_EQ(set.episodes[0].id, "Room/chair/0000");
  EXPECT_EQ(set.episodes[1].id, "Room/couch/0001");
  content["episodes"][0]["tasks"][2] = Json::array({"bed", "object", nullptr});
  put(content);
  EXPECT_THAT(refusal(), HasSubstr("no goal under \"Room.basis.glb_bed\""));
}

TEST_F(HabitatFileTest, EqualIdsGetDifferentEpisodes) {
  Json content = small_content();
  content["episodes"].push_back(content["episodes"][0]);
  put(content);
  const episodes::EpisodeSet set = episodes::episodes_from_habitat(
      episodes::read_habitat(file_).scenes[0], "val", std::nullopt, 1);
  EXPECT_NE(set.episodes[0].id, set.episodes[1].id);
  EXPECT_NE(set.episodes[0].seed, set.episodes[1].seed);
}

TEST_F(HabitatFileTest, BadFilesAreRefusedWithTheirPlace) {
  support::write_gzip(file_, "not json");
  EXPECT_THAT(refusal(), HasSubstr("JSON"));
  put(Json::array());
  EXPECT_THAT(refusal(), HasSubstr("\"episodes\""));
  put({{"episodes", Json::array()}});
  EXPECT_THAT(refusal(), HasSubstr("content"));
  for (const char* key :
       {"episode_id", "scene_id", "object_category", "start_position", "start_rotation"}) {
    Json content = small_content();
    content["episodes"][0].erase(key);
    put(content);
    EXPECT_THAT(refusal(), testing::AllOf(HasSubstr("episodes[0]"), HasSubstr(key)));
  }
  Json content = small_content();
  content["episodes"][0]["start_position"] = {1, 2};
  put(content);
  EXPECT_THAT(refusal(), HasSubstr("3 numbers"));
  content = small_content();
  content["episodes"][0]["start_rotation"] = {0, 0, 0, 2};
  put(content);
  EXPECT_THAT(refusal(), HasSubstr("unit quaternion"));
  content = small_content();
  content["episodes"][0]["object_category"] = "sofa";
  put(content);
  EXPECT_THAT(refusal(), HasSubstr("Room.basis.glb_sofa"));
}

/// Our own episodes, written for Habitat and read again.
class HabitatRoundTrip : public testing::Test {
 protected:
  static episodes::EpisodeSet generate(const core::SceneBundle& bundle,
                                       const sim::World& world) {
    const auto eye = renderer::make_cpu_renderer(
        std::make_shared<renderer::SurfelCloud>(TinyScene().surfels()), {});
    episodes::EpisodeRules rules;
    rules.goals = {"couch", "chair"};
    rules.count = 4;
    rules.camera = core::CameraIntrinsics::from_fov(96, 72, 1.2);
    rules.camera_height_m = 1.0;
    rules.min_start_m = 1.0;
    return episodes::generate_episodes("tiny", bundle, world, *eye, rules);
  }
};

TEST_F(HabitatRoundTrip, GivesBackTheSameTasks) {
  const TemporaryFolder folder("roundtrip");
  const core::SceneBundle bundle =
      core::load_bundle(TinyScene().write(folder.path() / "tiny"));
  const sim::World world = sim::World::load(bundle, sim::RobotModel::jackal_gentle());
  const episodes::EpisodeSet set = generate(bundle, world);

  // A levelled bundle: the source lies 0.3 m lower, and turned about the vertical.
  core::SceneLevelling levelling;
  levelling.R_world_source = glm::angleAxis(0.4, glm::dvec3(0, 0, 1));
  levelling.p_world_source_m = {1.0, -2.0, 0.3};
  (void)episodes::write_habitat(folder.path() / "out", "mini", "x/tiny.glb", set, bundle,
                                levelling);

  const episodes::HabitatDataset dataset =
      episodes::read_habitat(folder.path() / "out" / "mini.json.gz");
  EXPECT_EQ(dataset.split, "mini");
  ASSERT_EQ(dataset.scenes.size(), 1U);
  const episodes::HabitatBinding binding{&bundle, &levelling, &world};
  episodes::HabitatImportCounts counts;
  const episodes::EpisodeSet again =
      episodes::episodes_from_habitat(dataset.scenes[0], "mini", binding, set.seed, &counts);
  ASSERT_EQ(again.episodes.size(), set.episodes.size());
  EXPECT_EQ(counts.other_floor + counts.unreachable + counts.blocked_start, 0);
  for (std::size_t i = 0; i < set.episodes.size(); ++i) {
    const sim::Episode &a = set.episodes[i], &b = again.episodes[i];
    EXPECT_EQ(a.class_name, b.class_name);
    EXPECT_NEAR(a.start.x_m, b.start.x_m, 1e-9);
    EXPECT_NEAR(a.start.y_m, b.start.y_m, 1e-9);
    EXPECT_NEAR(core::wrap_angle_rad(a.start.yaw_rad - b.start.yaw_rad), 0.0, 1e-9);
    EXPECT_NEAR(a.shortest_path_m, b.shortest_path_m, 1e-6);
    ASSERT_EQ(a.view_points_m.size(), b.view_points_m.size());
    EXPECT_EQ(a.view_point_instance, b.view_point_instance);
    for (std::size_t k = 0; k < a.view_points_m.size(); ++k) {
      EXPECT_NEAR(glm::distance(a.view_points_m[k], b.view_points_m[k]), 0.0, 1e-9);
    }
  }
}

TEST_F(HabitatRoundTrip, GoalsAreThoseOfAllEpisodesOfACategory) {
  const TemporaryFolder folder("union");
  const core::SceneBundle bundle =
      core::load_bundle(TinyScene().write(folder.path() / "tiny"));
  const sim::World world = sim::World::load(bundle, sim::RobotModel::jackal_gentle());
  // The first couch episode knows one view point, the second that one and another.
  episodes::EpisodeSet set = generate(bundle, world);
  std::erase_if(set.episodes, [](const sim::Episode& e) { return e.class_name != "couch"; });
  ASSERT_GE(set.episodes.size(), 2U);
  set.episodes.resize(2);
  for (std::size_t n = 0; n < 2; ++n) {
    sim::Episode& episode = set.episodes[n];
    ASSERT_GE(episode.view_points_m.size(), 2U);
    episode.view_points_m.resize(n + 1);
    episode.view_point_instance.resize(n + 1);
    episode.view_point_iou.resize(n + 1);
  }
  (void)episodes::write_habitat(folder.path() / "out", "mini", "x/tiny.glb", set, bundle, {});
  const episodes::HabitatDataset dataset =
      episodes::read_habitat(folder.path() / "out" / "mini.json.gz");
  std::size_t points = 0;
  for (const episodes::HabitatGoal& goal : dataset.scenes[0].goals.at("sofa")) {
    points += goal.view_points.size();
  }
  EXPECT_EQ(points, 2U);
}

TEST_F(HabitatRoundTrip, WhatTheSceneLacksIsRefused) {
  const TemporaryFolder folder("lacks");
  const core::SceneBundle bundle =
      core::load_bundle(TinyScene().write(folder.path() / "tiny"));
  const sim::World world = sim::World::load(bundle, sim::RobotModel::jackal_gentle());
  Json content = small_content();
  content["episodes"][0]["object_category"] = "toilet";
  content["goals_by_category"] = {
      {"Room.basis.glb_toilet", small_content()["goals_by_category"]["Room.basis.glb_chair"]}};
  support::write_gzip(folder.path() / "val.json.gz", content.dump());
  const core::SceneLevelling level;
  const episodes::HabitatBinding binding{&bundle, &level, &world};
  try {
    (void)episodes::episodes_from_habitat(
        episodes::read_habitat(folder.path() / "val.json.gz").scenes[0], "val", binding, 1);
    FAIL() << "a class that the bundle lacks was accepted";
  } catch (const core::InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("\"toilet\""));
  }
}

TEST(HabitatValMini, TheRealFilesLoad) {
  const char* data = std::getenv("SEGSIM_DATA");
  if (data == nullptr) GTEST_SKIP() << "SEGSIM_DATA is not set";
  const fs::path file = fs::path(data) / "hm3d_objectnav_val_mini" / "val_mini.json.gz";
  if (!fs::exists(file)) GTEST_SKIP() << "no val_mini files";
  const episodes::HabitatDataset dataset = episodes::read_habitat(file);
  EXPECT_EQ(dataset.split, "val_mini");
  ASSERT_EQ(dataset.scenes.size(), 2U);
  EXPECT_EQ(dataset.scenes[0].name, "TEEsavR23oF");
  EXPECT_EQ(dataset.scenes[1].name, "wcojb4TFT35");
  int episodes = 0;
  // Counted by a script of a few lines in another language.
  const std::array<episodes::HabitatImportCounts, 2> expected{
      {{15, 0, 0, 0, 6191, 1156, 6}, {15, 0, 0, 0, 6117, 807, 7}}};
  for (std::size_t n = 0; n < dataset.scenes.size(); ++n) {
    const episodes::HabitatScene& scene = dataset.scenes[n];
    EXPECT_EQ(scene.episodes.size(), 15U);
    episodes::HabitatImportCounts counts;
    const episodes::EpisodeSet set =
        episodes::episodes_from_habitat(scene, dataset.split, std::nullopt, 1, &counts);
    EXPECT_EQ(counts.other_floor, expected[n].other_floor);
    EXPECT_EQ(counts.view_points, expected[n].view_points);
    EXPECT_EQ(counts.view_points_of_other_floors, expected[n].view_points_of_other_floors);
    EXPECT_EQ(counts.goal_sets, expected[n].goal_sets);
    for (std::size_t i = 0; i < set.episodes.size(); ++i) {
      const sim::Episode& episode = set.episodes[i];
      const episodes::HabitatEpisode& from = scene.episodes[i];
      ++episodes;
      // Lengths agree with the file, and the start is where the file says, seen from above.
      if (std::isfinite(episode.shortest_path_m)) {
        EXPECT_DOUBLE_EQ(episode.shortest_path_m, *from.geodesic_m);
      }
      EXPECT_DOUBLE_EQ(episode.start.x_m, from.start_habitat_m.x);
      EXPECT_DOUBLE_EQ(episode.start.y_m, -from.start_habitat_m.z);
      // What lies on the start's floor, sought for each episode by itself.
      std::vector<glm::dvec2> on_floor_m;
      for (const episodes::HabitatGoal& goal : scene.goals.at(from.category)) {
        for (const episodes::HabitatViewPoint& point : goal.view_points) {
          if (std::abs(point.p_habitat_m.y - from.start_habitat_m.y) > 0.5) continue;
          on_floor_m.emplace_back(episodes::source_from_habitat(point.p_habitat_m));
        }
      }
      EXPECT_EQ(episode.view_points_m, on_floor_m) << episode.id;
      // The straight way is never longer than the file's geodesic to the nearest view point.
      double straight_m = 1e9;
      for (const glm::dvec2& p : episode.view_points_m) {
        straight_m = std::min(
            straight_m, glm::distance(p, glm::dvec2(episode.start.x_m, episode.start.y_m)));
      }
      if (!episode.view_points_m.empty()) {
        EXPECT_LE(straight_m, *from.geodesic_m + 0.01) << episode.id;
      }
    }
  }
  EXPECT_EQ(episodes, 30);
}

}  // namespace
}  // namespace segsim::experiments
