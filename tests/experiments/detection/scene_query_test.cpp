#include "experiments/detection/scene_query.h"

#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"
#include "renderer/cpu_renderer.h"
#include "tests/experiments/surfel_room.h"
#include "tests/perception/clip_model.h"
#include "tests/temporary_folder.h"

namespace segsim::experiments {
namespace {

using detection::QueriedInstance;
using testing::ElementsAre;

constexpr float kShC0 = 0.28209479F;

/// A cube of 0.4 m on the floor in one colour.
void append_cube(renderer::SurfelCloud& cloud, const glm::dvec3& corner,
                 const glm::vec3& colour, std::uint16_t instance_id) {
  const std::size_t begin = cloud.size();
  const double s = 0.4;
  internal::append_patch(cloud, corner, {0, 0, s}, {0, s, 0}, kBoxClass);
  internal::append_patch(cloud, corner + glm::dvec3(s, 0, 0), {0, s, 0}, {0, 0, s}, kBoxClass);
  internal::append_patch(cloud, corner, {s, 0, 0}, {0, 0, s}, kBoxClass);
  internal::append_patch(cloud, corner + glm::dvec3(0, s, 0), {0, 0, s}, {s, 0, 0}, kBoxClass);
  internal::append_patch(cloud, corner + glm::dvec3(0, 0, s), {s, 0, 0}, {0, s, 0}, kBoxClass);
  for (std::size_t i = begin; i < cloud.size(); ++i) {
    cloud.sh[i] = (colour - 0.5F) / kShC0;
    cloud.instance_id[i] = instance_id;
  }
}

core::SceneInstance cube_instance(const glm::dvec3& corner, std::uint16_t id,
                                  const char* name) {
  return {id, kBoxClass, name, corner, corner + glm::dvec3(0.4)};
}

struct ColouredCubes {
  ColouredCubes() {
    auto cloud = std::make_shared<renderer::SurfelCloud>();
    internal::append_patch(*cloud, {-3, -3, 0}, {6, 0, 0}, {0, 6, 0}, kShellClass);
    const glm::dvec3 red(-1.2, 0, 0), blue(1.2, 0, 0);
    append_cube(*cloud, red, {0.9F, 0.05F, 0.05F}, 1);
    append_cube(*cloud, blue, {0.05F, 0.05F, 0.9F}, 2);
    renderer = renderer::make_cpu_renderer(cloud, {.threads = 1});
    manifest.name = "cubes";
    manifest.classes = {{kShellClass, "floor", false}, {kBoxClass, "cube", true}};
    manifest.instances = {cube_instance(red, 1, "red"), cube_instance(blue, 2, "blue"),
                          cube_instance({20, 0, 0}, 3, "away")};
  }
  std::unique_ptr<core::Renderer> renderer;
  core::SceneManifest manifest;
};

/// The model takes "chair" for red and "table" for blue.
TEST(SceneQuery, ThingsAreRankedByHowTheyLook) {
  const tests::TemporaryFolder folder;
  const auto scorer =
      perception::load_image_text_scorer(perception::write_clip(folder / "", "clip"));
  ColouredCubes scene;
  int calls = 0;
  const std::vector<std::string> phrases{"chair", "table"};
  const std::vector<QueriedInstance> things = detection::query_scene(
      *scene.renderer, scene.manifest, *scorer, phrases, {}, [&](int done, int all) {
        EXPECT_EQ(done, ++calls);
        EXPECT_EQ(all, 3);
      });
  ASSERT_EQ(things.size(), 3U);
  EXPECT_EQ(calls, 3);
  EXPECT_EQ(things[0].class_name, "cube");
  EXPECT_EQ(things[0].views, 4);
  EXPECT_THAT(detection::ranking(things, 0), ElementsAre(0, 1));
  EXPECT_THAT(detection::ranking(things, 1), ElementsAre(1, 0));
  EXPECT_GT(things[0].scores[0], things[1].scores[0] + 0.2);
  EXPECT_EQ(things[2].views, 0) << "no camera sees what has no surfels";
  EXPECT_TRUE(things[2].scores.empty());

  // The crop shows the cube and something around it.
  const core::Rgb8 middle =
      things[0].picture(things[0].picture.width_px() / 2, things[0].picture.height_px() / 2);
  EXPECT_GT(middle.r, 150);
  EXPECT_LT(middle.b, 80);
  EXPECT_GT(detection::query_picture(things, phrases, 2).width_px(), 100);
}

/// Three chairs and a table, scored for two phrases; one chair was never seen.
std::vector<QueriedInstance> scored_things() {
  std::vector<QueriedInstance> things(5);
  const char* classes[] = {"chair", "table", "chair", "chair", "chair"};
  const double scores[][2] = {{0.1, 0.3}, {0.9, 0.4}, {0.7, 0.6}, {}, {0.2, 0.5}};
  for (std::size_t i = 0; i < things.size(); ++i) {
    things[i].id = static_cast<std::uint16_t>(i + 1);
    things[i].name = "thing " + std::to_string(i + 1);
    things[i].class_name = classes[i];
    things[i].centre_m = {0.1 * static_cast<double>(i), 1.0 / 3.0, 0.5};
    if (i == 3) continue;
    things[i].views = 2;
    things[i].scores = {scores[i][0], scores[i][1]};
  }
  return things;
}

TEST(SceneQuery, APhraseMeansTheBestThingsOfTheClassOfTheBest) {
  const std::vector<QueriedInstance> things = scored_things();
  EXPECT_THAT(detection::meant_by(things, 1, 1), ElementsAre(2));
  EXPECT_THAT(detection::meant_by(things, 1, 2), ElementsAre(2, 4)) << "the table is third";
  EXPECT_THAT(detection::meant_by(things, 1, 9), ElementsAre(2, 4, 0)) << "one was not seen";
  EXPECT_THAT(detection::meant_by(things, 0, 3), ElementsAre(1)) << "there is one table";
  EXPECT_TRUE(detection::meant_by({}, 0, 1).empty());
}

TEST(SceneQuery, AnswersAreReadBackAsTheyWereWritten) {
  const tests::TemporaryFolder folder;
  const auto file = folder / "query.json";
  const detection::SceneQuery query{"clip.yaml", {"a red chair", "a table"}, scored_things()};
  detection::write_query(file, query);
  const detection::SceneQuery read = detection::read_query(file);
  EXPECT_EQ(read.model, query.model);
  EXPECT_EQ(read.phrases, query.phrases);
  ASSERT_EQ(read.instances.size(), query.instances.size());
  for (std::size_t i = 0; i < read.instances.size(); ++i) {
    EXPECT_EQ(read.instances[i].id, query.instances[i].id);
    EXPECT_EQ(read.instances[i].name, query.instances[i].name);
    EXPECT_EQ(read.instances[i].class_name, query.instances[i].class_name);
    EXPECT_EQ(read.instances[i].centre_m, query.instances[i].centre_m);
    EXPECT_EQ(read.instances[i].views, query.instances[i].views);
    EXPECT_EQ(read.instances[i].scores, query.instances[i].scores);
  }
  std::string text = core::read_file(file);
  text.replace(text.find("0.9"), 3, "\"?\"");
  std::ofstream(file) << text;
  EXPECT_THROW((void)detection::read_query(file), core::InputError);
  std::ofstream(file) << text.substr(0, text.size() / 2);
  EXPECT_THROW((void)detection::read_query(file), core::InputError);
}

TEST(SceneQuery, ASceneWithoutThingsIsRefused) {
  const tests::TemporaryFolder folder;
  const auto scorer =
      perception::load_image_text_scorer(perception::write_clip(folder / "", "clip"));
  ColouredCubes scene;
  scene.manifest.instances.clear();
  EXPECT_THROW(
      (void)detection::query_scene(*scene.renderer, scene.manifest, *scorer, {"chair"}),
      core::InputError);
}

}  // namespace
}  // namespace segsim::experiments
