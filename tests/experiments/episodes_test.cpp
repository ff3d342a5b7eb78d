#include "experiments/episodes.h"

#include <fstream>
#include <map>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"
#include "renderer/cpu_renderer.h"
#include "tiny_scene.h"

namespace segsim::experiments {
namespace {

using testing::HasSubstr;

/// The bundle is made once for all tests of this file.
class EpisodesTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder("episodes");
    bundle_ =
        new core::SceneBundle(core::load_bundle(TinyScene().write(folder_->path() / "tiny")));
    world_ = new sim::World(sim::World::load(*bundle_, sim::RobotModel::jackal_gentle()));
    renderer_ = renderer::make_cpu_renderer(
                    std::make_shared<renderer::SurfelCloud>(TinyScene().surfels()), {})
                    .release();
  }
  static void TearDownTestSuite() {
    delete renderer_;
    delete world_;
    delete bundle_;
    delete folder_;
  }

  static EpisodeRules rules() {
    EpisodeRules rules;
    rules.goals = {"couch", "chair"};
    rules.count = 8;
    rules.seed = 5;
    rules.camera = core::CameraIntrinsics::from_fov(96, 72, 1.2);
    rules.camera_height_m = 1.0;
    rules.camera_pitch_down_rad = 0.2;
    rules.min_start_m = 1.0;
    return rules;
  }
  static EpisodeSet generate(const EpisodeRules& with) {
    return generate_episodes("tiny", *bundle_, *world_, *renderer_, with);
  }
  static std::string text_of(const EpisodeSet& set) {
    const auto file = folder_->path() / "set.jsonl";
    write_episodes(file, set);
    return core::read_file(file);
  }

  static TemporaryFolder* folder_;
  static core::SceneBundle* bundle_;
  static sim::World* world_;
  static core::Renderer* renderer_;
};
TemporaryFolder* EpisodesTest::folder_ = nullptr;
core::SceneBundle* EpisodesTest::bundle_ = nullptr;
sim::World* EpisodesTest::world_ = nullptr;
core::Renderer* EpisodesTest::renderer_ = nullptr;

TEST_F(EpisodesTest, EqualArgumentsGiveEqualEpisodes) {
  EXPECT_EQ(text_of(generate(rules())), text_of(generate(rules())));
  EpisodeRules other = rules();
  other.seed = 6;
  EXPECT_NE(text_of(generate(rules())), text_of(generate(other)));
}

TEST_F(EpisodesTest, EveryEpisodeKeepsTheRules) {
  const EpisodeSet set = generate(rules());
  ASSERT_EQ(set.episodes.size(), 8U);
  std::map<std::string, int> per_class;
  std::set<std::string> ids;
  const auto T_robot_camera = core::mast_camera(1.0, 0.2);
  for (const sim::Episode& episode : set.episodes) {
    ++per_class[episode.class_name];
    EXPECT_TRUE(ids.insert(episode.id).second) << episode.id;
    EXPECT_THAT(episode.id, HasSubstr("tiny/" + episode.class_name + "/"));
    EXPECT_GE(episode.shortest_path_m, 1.0);
    EXPECT_LE(episode.shortest_path_m, 15.0);
    EXPECT_FALSE(world_->collision().collides(episode.start));
    const double again_m =
        world_->distance_to(episode.view_points_m).at({episode.start.x_m, episode.start.y_m});
    EXPECT_NEAR(episode.shortest_path_m, again_m, 1e-6);

    // The goal is out of view at the start.
    const std::uint16_t id = bundle_->manifest.find_class(episode.class_name)->id;
    const core::Frame seen = renderer_->render(
        core::transform_from_pose2<core::frame::World>(episode.start) * T_robot_camera,
        rules().camera, core::Channels::kLabels);
    EXPECT_LT(std::count(seen.semantic.pixels().begin(), seen.semantic.pixels().end(), id),
              40);
  }
  EXPECT_EQ(per_class["couch"], 4);
  EXPECT_EQ(per_class["chair"], 4);
  EXPECT_GT(set.rejections.starts_goal_visible, 0);
}

TEST_F(EpisodesTest, FromEveryViewPointTheRobotSeesTheGoal) {
  const EpisodeSet set = generate(rules());
  const auto T_robot_camera = core::mast_camera(1.0, 0.2);
  for (const sim::Episode& episode : set.episodes) {
    const bool couch = episode.class_name == "couch";
    const core::SceneInstance& goal = bundle_->manifest.instances[couch ? 0 : 1];
    ASSERT_FALSE(episode.view_points_m.empty());
    for (const glm::dvec2& place : episode.view_points_m) {
      const core::Pose2 pose = sim::facing(place, goal.box_min_m, goal.box_max_m);
      const core::Frame seen = renderer_->render(
          core::transform_from_pose2<core::frame::World>(pose) * T_robot_camera,
          rules().camera, core::Channels::kLabels);
      EXPECT_GE(
          std::count(seen.instance.pixels().begin(), seen.instance.pixels().end(), goal.id),
          40);
    }
    if (&episode - set.episodes.data() >= 1) break;  // One of each class is enough.
  }
}

TEST_F(EpisodesTest, AClassThatTheSceneLacksIsCounted) {
  EpisodeRules with_bed = rules();
  with_bed.goals.emplace_back("bed");
  const EpisodeSet set = generate(with_bed);
  EXPECT_EQ(set.rejections.goals_without_instance, 1);
  EXPECT_EQ(set.episodes.size(), 8U);
  EpisodeRules only_bed = rules();
  only_bed.goals = {"bed"};
  EXPECT_THROW((void)generate(only_bed), core::InputError);
}

TEST_F(EpisodesTest, AFileGivesBackWhatWasWritten) {
  const EpisodeSet set = generate(rules());
  const auto file = folder_->path() / "set.jsonl";
  write_episodes(file, set);
  const EpisodeSet read = read_episodes(file);
  EXPECT_EQ(read.scene_sha256, bundle_->scene_sha256);
  EXPECT_EQ(read.rules_sha256, rules_hash(rules(), "jackal-gentle"));
  ASSERT_EQ(read.episodes.size(), set.episodes.size());
  for (std::size_t i = 0; i < set.episodes.size(); ++i) {
    EXPECT_EQ(read.episodes[i].id, set.episodes[i].id);
    EXPECT_EQ(read.episodes[i].seed, set.episodes[i].seed);
    EXPECT_EQ(read.episodes[i].start.yaw_rad, set.episodes[i].start.yaw_rad);
    EXPECT_EQ(read.episodes[i].shortest_path_m, set.episodes[i].shortest_path_m);
    EXPECT_EQ(read.episodes[i].view_points_m, set.episodes[i].view_points_m);
  }
}

TEST_F(EpisodesTest, EveryRuleIsInTheHash) {
  std::set<std::string> hashes{rules_hash(rules(), "a"), rules_hash(rules(), "b")};
  const auto vary = [&](auto change) {
    EpisodeRules varied = rules();
    change(varied);
    hashes.insert(rules_hash(varied, "a"));
  };
  vary([](EpisodeRules& r) { r.goals = {"chair", "couch"}; });
  vary([](EpisodeRules& r) { r.count = 9; });
  vary([](EpisodeRules& r) { r.seed = 6; });
  vary([](EpisodeRules& r) { r.camera.fx_px += 1e-9; });
  vary([](EpisodeRules& r) { r.camera_height_m = 1.1; });
  vary([](EpisodeRules& r) { r.view_radius_m = 1.1; });
  vary([](EpisodeRules& r) { r.min_visible_pixels = 41; });
  vary([](EpisodeRules& r) { r.max_start_m = 14; });
  vary([](EpisodeRules& r) { r.allow_visible_start = true; });
  EXPECT_EQ(hashes.size(), 11U);
}

/// The message with which a file of this text is refused.
std::string refusal(const std::filesystem::path& file, const std::string& text) {
  std::ofstream(file) << text;
  try {
    (void)read_episodes(file);
  } catch (const core::InputError& error) {
    return error.what();
  }
  return {};
}

TEST_F(EpisodesTest, BrokenFilesAreRefusedWithTheirLine) {
  const std::string good = text_of(generate(rules()));
  const auto file = folder_->path() / "broken.jsonl";
  EXPECT_EQ(refusal(file, good), "");
  EXPECT_THAT(refusal(file, ""), HasSubstr("broken.jsonl"));
  EXPECT_THAT(refusal(file, "{}\n"), HasSubstr("broken.jsonl:1"));

  const std::size_t second = good.find('\n') + 1, third = good.find('\n', second) + 1;
  std::string cut = good;
  cut.erase(third + 40, 20);
  EXPECT_THAT(refusal(file, cut), HasSubstr("broken.jsonl:3"));
  std::string no_places = good;
  no_places.replace(no_places.find("\"start\"", second), 7, "\"stort\"");
  EXPECT_THAT(refusal(file, no_places), HasSubstr("broken.jsonl:2"));
  EXPECT_THAT(refusal(file, good.substr(0, third)), HasSubstr("8 episodes"));
}

}  // namespace
}  // namespace segsim::experiments
