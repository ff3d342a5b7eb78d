#include "experiments/episodes/episodes.h"

#include <cmath>
#include <fstream>
#include <map>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/episodes/episode_check.h"
#include "renderer/cpu_renderer.h"
#include "tests/experiments/tiny_scene.h"

namespace segsim::experiments {
namespace {

using testing::Contains;
using testing::Each;
using testing::ElementsAre;
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

  static episodes::EpisodeRules rules() {
    episodes::EpisodeRules rules;
    rules.goals = {"couch", "chair"};
    rules.count = 8;
    rules.seed = 5;
    rules.camera = core::CameraIntrinsics::from_fov(96, 72, 1.2);
    rules.camera_height_m = 1.0;
    rules.camera_pitch_down_rad = 0.2;
    rules.min_start_m = 1.0;
    return rules;
  }
  static episodes::EpisodeSet generate(const episodes::EpisodeRules& with) {
    return episodes::generate_episodes("tiny", *bundle_, *world_, *renderer_, with);
  }
  static std::string text_of(const episodes::EpisodeSet& set) {
    const auto file = folder_->path() / "set.jsonl";
    episodes::write_episodes(file, set);
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
  episodes::EpisodeRules other = rules();
  other.seed = 6;
  EXPECT_NE(text_of(generate(rules())), text_of(generate(other)));
}

TEST_F(EpisodesTest, EveryEpisodeKeepsTheRules) {
  const episodes::EpisodeSet set = generate(rules());
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
  const episodes::EpisodeSet set = generate(rules());
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
  episodes::EpisodeRules with_bed = rules();
  with_bed.goals.emplace_back("bed");
  const episodes::EpisodeSet set = generate(with_bed);
  EXPECT_EQ(set.rejections.goals_without_instance, 1);
  EXPECT_EQ(set.episodes.size(), 8U);
  episodes::EpisodeRules only_bed = rules();
  only_bed.goals = {"bed"};
  EXPECT_THROW((void)generate(only_bed), core::InputError);
}

TEST_F(EpisodesTest, AFileGivesBackWhatWasWritten) {
  const episodes::EpisodeSet set = generate(rules());
  const auto file = folder_->path() / "set.jsonl";
  episodes::write_episodes(file, set);
  const episodes::EpisodeSet read = episodes::read_episodes(file);
  EXPECT_EQ(read.scene_sha256, bundle_->scene_sha256);
  EXPECT_EQ(read.rules_sha256, episodes::rules_hash(rules(), "jackal-gentle"));
  ASSERT_EQ(read.episodes.size(), set.episodes.size());
  for (std::size_t i = 0; i < set.episodes.size(); ++i) {
    EXPECT_EQ(read.episodes[i].id, set.episodes[i].id);
    EXPECT_EQ(read.episodes[i].seed, set.episodes[i].seed);
    EXPECT_EQ(read.episodes[i].start.yaw_rad, set.episodes[i].start.yaw_rad);
    EXPECT_EQ(read.episodes[i].shortest_path_m, set.episodes[i].shortest_path_m);
    EXPECT_EQ(read.episodes[i].view_points_m, set.episodes[i].view_points_m);
  }
}

TEST_F(EpisodesTest, TheHeaderSaysWhatItWasMadeFor) {
  episodes::EpisodeSet set = generate(rules());
  set.oracle = episodes::OracleRecord{7, 8, 0.625, "habitat-hm3d"};
  const auto file = folder_->path() / "set.jsonl";
  episodes::write_episodes(file, set);
  const episodes::EpisodeSet read = episodes::read_episodes(file);
  EXPECT_THAT(read.generator, HasSubstr("segsim "));
  EXPECT_EQ(read.seed, 5U);
  EXPECT_EQ(read.navmesh_sha256,
            episodes::navmesh_settings_hash(sim::RobotModel::jackal_gentle()));
  EXPECT_NE(read.navmesh_sha256.size(), 0U);
  ASSERT_TRUE(read.viewer && read.oracle);
  EXPECT_EQ(read.viewer->camera.width_px, 96);
  EXPECT_EQ(read.viewer->camera.fx_px, rules().camera.fx_px);
  EXPECT_EQ(read.viewer->camera_height_m, 1.0);
  EXPECT_EQ(read.viewer->camera_pitch_down_rad, 0.2);
  EXPECT_EQ(read.oracle->successes, 7);
  EXPECT_EQ(read.oracle->profile, "habitat-hm3d");
  EXPECT_DOUBLE_EQ(read.oracle->rate(), 0.875);
  EXPECT_THAT(core::read_file(file), HasSubstr("\"flagged\":true"));
}

TEST_F(EpisodesTest, ViewPointsKnowTheirInstanceAndHowWellTheySee) {
  const episodes::EpisodeSet set = generate(rules());
  const auto T_robot_camera = core::mast_camera(1.0, 0.2);
  for (const sim::Episode& episode : set.episodes) {
    const bool couch = episode.class_name == "couch";
    const core::SceneInstance& goal = bundle_->manifest.instances[couch ? 0 : 1];
    ASSERT_EQ(episode.view_point_instance.size(), episode.view_points_m.size());
    ASSERT_EQ(episode.view_point_iou.size(), episode.view_points_m.size());
    for (std::size_t k = 0; k < episode.view_points_m.size(); k += 7) {
      EXPECT_EQ(episode.view_point_instance[k], goal.id);
      const core::Pose2 pose =
          sim::facing(episode.view_points_m[k], goal.box_min_m, goal.box_max_m);
      const core::Frame seen = renderer_->render(
          core::transform_from_pose2<core::frame::World>(pose) * T_robot_camera,
          rules().camera, core::Channels::kLabels);
      int both = 0, either = 0;
      for (int j = 0; j < 72; ++j) {
        for (int i = 0; i < 96; ++i) {
          const bool of_goal = seen.instance(i, j) == goal.id;
          const bool in_box = i >= 24 && i < 72 && j >= 18 && j < 54;
          both += of_goal && in_box ? 1 : 0;
          either += of_goal || in_box ? 1 : 0;
        }
      }
      EXPECT_FLOAT_EQ(episode.view_point_iou[k],
                      static_cast<float>(both) / static_cast<float>(either));
    }
    if (&episode - set.episodes.data() >= 1) break;  // One of each class is enough.
  }
}

TEST_F(EpisodesTest, AFileOfTheFirstSchemaIsRead) {
  std::string text = text_of(generate(rules()));
  text.replace(text.find("segsim.episodes/2"), 17, "segsim.episodes/1");
  // The first schema had neither of these.
  for (const char* key : {",\"generator\":\"", ",\"navmesh_sha256\":\""}) {
    const std::size_t at = text.find(key);
    ASSERT_NE(at, std::string::npos);
    text.erase(at, text.find('"', at + std::string(key).size()) + 1 - at);
  }
  const auto file = folder_->path() / "first.jsonl";
  std::ofstream(file) << text;
  const episodes::EpisodeSet set = episodes::read_episodes(file);
  EXPECT_EQ(set.episodes.size(), 8U);
  EXPECT_EQ(set.generator, "");
}

TEST_F(EpisodesTest, APhraseIsSearchedAtItsThingsAlone) {
  const TemporaryFolder folder("phrases");
  const TinyScene scene(TinyScene::Chairs::kTwo);
  const core::SceneBundle bundle = core::load_bundle(scene.write(folder / "tiny"));
  const sim::World world = sim::World::load(bundle, sim::RobotModel::jackal_gentle());
  const auto renderer = renderer::make_cpu_renderer(
      std::make_shared<renderer::SurfelCloud>(scene.surfels()), {});
  episodes::EpisodeRules with = rules();
  with.goals = {"chair"};
  with.phrases = {{"A blue chair!", "chair", {TinyScene::kBlueChair}}};
  with.count = 4;
  const episodes::EpisodeSet set =
      episodes::generate_episodes("tiny", bundle, world, *renderer, with);
  ASSERT_EQ(set.episodes.size(), 4U);
  const sim::Episode &any = set.episodes[0], &blue = set.episodes[1];
  EXPECT_EQ(any.id, "tiny/chair/00");
  EXPECT_EQ(any.goal_name(), "chair");
  EXPECT_TRUE(any.goal_instances.empty());
  EXPECT_THAT(any.view_point_instance, Contains(TinyScene::kRedChair));
  EXPECT_THAT(any.view_point_instance, Contains(TinyScene::kBlueChair));
  EXPECT_EQ(blue.id, "tiny/a-blue-chair/00");
  EXPECT_EQ(blue.class_name, "chair");
  EXPECT_EQ(blue.goal_name(), "A blue chair!");
  EXPECT_THAT(blue.view_point_instance, Each(TinyScene::kBlueChair));
  EXPECT_LT(blue.view_points_m.size(), any.view_points_m.size());

  const auto file = folder / "set.jsonl";
  episodes::write_episodes(file, set);
  const std::string text = core::read_file(file);
  EXPECT_THAT(text, HasSubstr("segsim.episodes/3"));
  episodes::EpisodeSet read = episodes::read_episodes(file);
  EXPECT_EQ(read.episodes[1].phrase, "A blue chair!");
  EXPECT_THAT(read.episodes[1].goal_instances, ElementsAre(TinyScene::kBlueChair));
  EXPECT_TRUE(read.episodes[0].phrase.empty());
  episodes::write_episodes(folder / "again.jsonl", read);
  EXPECT_EQ(core::read_file(folder / "again.jsonl"), text);

  const auto bind = [&] { (void)episodes::bind_episodes(read, "set.jsonl", bundle, world); };
  EXPECT_NO_THROW(bind());
  read.episodes[1].goal_instances = {1};  // The couch.
  EXPECT_THROW(bind(), core::InputError);
}

TEST_F(EpisodesTest, APhraseWithoutItsThingsIsRefused) {
  episodes::EpisodeSet set = generate(rules());
  EXPECT_THAT(text_of(set), HasSubstr("segsim.episodes/2")) << "classes need no new version";
  set.episodes[0].phrase = "a red chair";
  const std::string no_things = text_of(set);
  set.episodes[0].goal_instances = {2};
  std::string no_phrase = text_of(set);
  const auto file = folder_->path() / "phrase.jsonl";
  std::ofstream(file) << no_phrase;
  EXPECT_NO_THROW((void)episodes::read_episodes(file));
  no_phrase.erase(no_phrase.find("\"phrase\":"), 23);
  for (const std::string& text : {no_things, no_phrase}) {
    std::ofstream(file) << text;
    EXPECT_THROW((void)episodes::read_episodes(file), core::InputError) << text;
  }
}

TEST_F(EpisodesTest, AnIslandThatIsTooSmallIsRefused) {
  episodes::EpisodeRules wide = rules();
  wide.min_island_radius_m = 1.5;
  EXPECT_EQ(generate(wide).episodes.size(), 8U);
  wide.min_island_radius_m = 4.0;  // 50 m2; the rooms have 40.
  EXPECT_THROW((void)generate(wide), core::InputError);
}

TEST_F(EpisodesTest, StraightStartsAreThinnedOut) {
  episodes::EpisodeRules strict = rules();
  strict.min_ratio = 1.3;
  const episodes::EpisodeSet set = generate(strict);
  EXPECT_GT(set.rejections.starts.too_straight, 0);
  EXPECT_EQ(generate(rules()).rejections.starts.too_straight, 0);
}

/// The states that binding finds, by episode.
std::vector<episodes::EpisodeState> states_of(episodes::EpisodeSet& set,
                                              const core::SceneBundle& bundle,
                                              const sim::World& world) {
  std::vector<episodes::EpisodeState> states;
  for (const episodes::EpisodeFinding& f :
       episodes::bind_episodes(set, "set.jsonl", bundle, world)) {
    states.push_back(f.state);
  }
  return states;
}

TEST_F(EpisodesTest, BindingFindsWhatCannotBeDone) {
  episodes::EpisodeSet set = generate(rules());
  set.episodes.resize(6);
  const double l_m = set.episodes[0].shortest_path_m;
  set.episodes[1].start = {40.0, 0.0, 0.0};
  set.episodes[2].view_points_m = {{40.0, 0.0}};
  set.episodes[3].view_points_m = {{set.episodes[3].start.x_m, set.episodes[3].start.y_m}};
  set.episodes[4].shortest_path_m += 1.0;
  set.episodes[5].view_points_m.clear();
  EXPECT_EQ(states_of(set, *bundle_, *world_),
            (std::vector<episodes::EpisodeState>{
                episodes::EpisodeState::kFine, episodes::EpisodeState::kOffNavmesh,
                episodes::EpisodeState::kUnreachable, episodes::EpisodeState::kTrivial,
                episodes::EpisodeState::kWrongLength, episodes::EpisodeState::kUnreachable}));
  EXPECT_EQ(set.episodes[0].shortest_path_m, l_m);
  EXPECT_FALSE(std::isfinite(set.episodes[1].shortest_path_m));
  EXPECT_FALSE(std::isfinite(set.episodes[2].shortest_path_m));
  EXPECT_EQ(set.episodes[3].shortest_path_m, 0.0);
}

TEST_F(EpisodesTest, BindingRefusesAnotherBundleAndUnknownClasses) {
  episodes::EpisodeSet set = generate(rules());
  set.episodes[2].class_name = "coach";
  try {
    (void)states_of(set, *bundle_, *world_);
    ADD_FAILURE() << "an unknown class was accepted";
  } catch (const core::InputError& error) {
    EXPECT_THAT(error.what(), testing::AllOf(HasSubstr("set.jsonl"), HasSubstr("\"coach\""),
                                             HasSubstr("near: couch")));
  }
  set = generate(rules());
  set.scene_sha256 = std::string(64, '0');
  EXPECT_THROW((void)states_of(set, *bundle_, *world_), core::InputError);
  set.scene_sha256.clear();  // Imported without a bundle: nothing to compare.
  EXPECT_EQ(states_of(set, *bundle_, *world_),
            std::vector<episodes::EpisodeState>(8, episodes::EpisodeState::kFine));
}

TEST_F(EpisodesTest, EveryRuleIsInTheHash) {
  std::set<std::string> hashes{episodes::rules_hash(rules(), "a"),
                               episodes::rules_hash(rules(), "b")};
  const auto vary = [&](auto change) {
    episodes::EpisodeRules varied = rules();
    change(varied);
    hashes.insert(episodes::rules_hash(varied, "a"));
  };
  vary([](episodes::EpisodeRules& r) { r.goals = {"chair", "couch"}; });
  vary([](episodes::EpisodeRules& r) { r.count = 9; });
  vary([](episodes::EpisodeRules& r) { r.seed = 6; });
  vary([](episodes::EpisodeRules& r) { r.camera.fx_px += 1e-9; });
  vary([](episodes::EpisodeRules& r) { r.camera_height_m = 1.1; });
  vary([](episodes::EpisodeRules& r) { r.view_radius_m = 1.1; });
  vary([](episodes::EpisodeRules& r) { r.min_visible_pixels = 41; });
  vary([](episodes::EpisodeRules& r) { r.max_start_m = 14; });
  vary([](episodes::EpisodeRules& r) { r.allow_visible_start = true; });
  vary([](episodes::EpisodeRules& r) { r.view_lattice_m = 0.1; });
  vary([](episodes::EpisodeRules& r) { r.min_ratio = 1.05; });
  vary([](episodes::EpisodeRules& r) { r.min_island_radius_m = 1.5; });
  vary([](episodes::EpisodeRules& r) { r.phrases = {{"a red chair", "chair", {2}}}; });
  vary([](episodes::EpisodeRules& r) { r.phrases = {{"a red chair", "chair", {3}}}; });
  vary([](episodes::EpisodeRules& r) { r.phrases = {{"the red chair", "chair", {2}}}; });
  EXPECT_EQ(hashes.size(), 17U);
}

/// The message with which a file of this text is refused.
std::string refusal(const std::filesystem::path& file, const std::string& text) {
  std::ofstream(file) << text;
  try {
    (void)episodes::read_episodes(file);
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
  std::string uneven = good;
  const std::size_t list = uneven.find("\"view_point_instances\":[", second) + 24;
  uneven.erase(list, uneven.find(',', list) + 1 - list);
  EXPECT_THAT(refusal(file, uneven), HasSubstr("broken.jsonl:2"));
  // Numbers that a conversion would turn into others.
  const auto with = [&](const std::string& key, const std::string& value) {
    std::string changed = good;
    const std::size_t at = changed.find(key, second) + key.size();
    return changed.replace(at, changed.find_first_of(",]", at) - at, value);
  };
  EXPECT_EQ(refusal(file, with("\"view_point_ious\":[", "0.25")), "");
  for (const auto& [key, value] : std::vector<std::pair<std::string, std::string>>{
           {"\"view_points\":[[", "1e308"},
           {"\"start\":[", "-1e300"},
           {"\"view_point_instances\":[", "1e23"},
           {"\"view_point_instances\":[", "true"},
           {"\"view_point_instances\":[", "70000"},
           {"\"view_point_ious\":[", "4294967296"},
           {"\"view_point_ious\":[", "-0.5"},
           {"\"seed\":", "1.5"}}) {
    EXPECT_THAT(refusal(file, with(key, value)), HasSubstr("broken.jsonl:2")) << key << value;
  }
  std::string newer = good;
  newer.replace(newer.find("episodes/2"), 10, "episodes/4");
  EXPECT_THAT(refusal(file, newer), HasSubstr("segsim.episodes/4"));
  std::string no_places = good;
  no_places.replace(no_places.find("\"start\"", second), 7, "\"stort\"");
  EXPECT_THAT(refusal(file, no_places), HasSubstr("broken.jsonl:2"));
  EXPECT_THAT(refusal(file, good.substr(0, third)), HasSubstr("8 episodes"));
}

}  // namespace
}  // namespace segsim::experiments
