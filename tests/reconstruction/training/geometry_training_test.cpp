#include "reconstruction/training/geometry_training.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <set>

#include <gmock/gmock.h>
#include <glm/geometric.hpp>

#include "core/error.h"
#include "core/random.h"
#include "reconstruction/evaluation/image_quality.h"
#include "reconstruction/training/pose_alignment.h"
#include "renderer/cpu_renderer.h"
#include "renderer/scene/room_scene.h"
#include "tests/temporary_folder.h"

namespace segsim::reconstruction {
namespace {

/// A small room, its exact pictures, and a start that is off in place and colour.
class SmallRoom {
 public:
  SmallRoom() {
    truth_ = std::make_shared<renderer::SurfelCloud>(
        renderer::make_room_scene({.surfel_count = 4000, .seed = 3, .spread = 1.2}));
    set_.intrinsics = core::CameraIntrinsics::from_fov(64, 48, 1.2);
    const auto renderer = renderer::make_cpu_renderer(truth_);
    std::size_t frame = 0;
    for (const core::CameraPose& pose : renderer::room_camera_ring(20)) {
      const core::Frame drawn = renderer->render(pose, set_.intrinsics, core::Channels::kRgbd);
      TrainingView view;
      view.frame = frame;
      view.name = "view " + std::to_string(frame);
      view.T_world_camera = pose;
      view.rgb = drawn.rgb;
      view.depth_m = drawn.depth_m;
      (frame % 5 == 0 ? set_.held_out : set_.training).push_back(std::move(view));
      ++frame;
    }
    start_ = *truth_;
    core::RandomStream random(1, "small_room");
    for (std::size_t i = 0; i < start_.size(); ++i) {
      for (int axis = 0; axis < 3; ++axis) {
        start_.position_m[i][axis] += static_cast<float>(0.01 * random.normal());
        start_.sh[i][axis] = 0.5F * start_.sh[i][axis];
      }
    }
    config_.iterations = 80;
    config_.sh_degree = 1;
    config_.rate.color = 0.02;
    config_.densify.max_surfels = 4600;
    config_.densify.max_growth = 0.02;
    config_.densify.min_gradient = 0.0;
    config_.densify.max_scale_extent = 1.0;  // The surfels of so small a scene are large.
  }

  [[nodiscard]] std::unique_ptr<GeometryTrainer> make(int threads = 1) const {
    return std::make_unique<GeometryTrainer>(set_, start_, config_, 5,
                                             GeometryDevice{.threads = threads});
  }

  [[nodiscard]] std::vector<core::CameraPose> poses() const {
    std::vector<core::CameraPose> poses;
    for (const TrainingView& view : set_.training) poses.push_back(view.T_world_camera);
    return poses;
  }

  struct Quality {
    ColorQuality color;
    DepthQuality depth;
  };
  [[nodiscard]] Quality held_out(const renderer::SurfelCloud& cloud) const {
    const auto renderer =
        renderer::make_cpu_renderer(std::make_shared<renderer::SurfelCloud>(cloud));
    Quality quality;
    for (const TrainingView& view : set_.held_out) {
      const core::Frame drawn =
          renderer->render(view.T_world_camera, set_.intrinsics, core::Channels::kRgbd);
      quality.color.add(drawn.rgb, view.rgb);
      quality.depth.add(drawn.depth_m, view.depth_m);
    }
    return quality;
  }

  std::shared_ptr<renderer::SurfelCloud> truth_;
  TrainingSet set_;
  renderer::SurfelCloud start_;
  GeometryConfig config_;
};

void expect_same(const renderer::SurfelCloud& a, const renderer::SurfelCloud& b) {
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(a.position_m, b.position_m);
  EXPECT_EQ(a.sh, b.sh);
  EXPECT_EQ(a.opacity, b.opacity);
  EXPECT_EQ(a.scale_m, b.scale_m);
}

TEST(GeometryTraining, ImprovesViewsItHasNotSeen) {
  SmallRoom room;
  room.config_.densify.max_growth = 0.0;  // The true scene has these surfels.
  const auto trainer = room.make(2);
  const double before_db = room.held_out(room.start_).color.psnr_db();
  std::int64_t surfels = 0;
  while (trainer->iteration() < room.config_.iterations) surfels = trainer->step().surfels;
  const renderer::SurfelCloud after = trainer->surfels();
  EXPECT_EQ(static_cast<std::int64_t>(after.size()), surfels);
  EXPECT_GT(room.held_out(after).color.psnr_db(), before_db + 5.0)
      << before_db << " dB before training";
  EXPECT_EQ(after.sh_degree, 1);
  EXPECT_LT(after.size(), room.start_.size());  // The faint ones are gone.
  renderer::check_surfels(after);
}

TEST(GeometryTraining, SplitsWithinTheBudget) {
  SmallRoom room;
  room.config_.densify.max_growth = 0.1;
  const auto trainer = room.make(2);
  std::int64_t surfels = 0, most = 0;
  while (trainer->iteration() < room.config_.iterations) {
    surfels = trainer->step().surfels;
    most = std::max(most, surfels);
  }
  EXPECT_GT(most, 4500);
  EXPECT_LE(most, room.config_.densify.max_surfels);
  renderer::check_surfels(trainer->surfels());
}

TEST(GeometryTraining, SplitsAlsoWhenItIsLongerThanPruningWaits) {
  SmallRoom room;
  room.config_.densify.every = 0.45;  // Pruning waits for two epochs, 32 of 80 images.
  const auto surfels_with_growth = [&](double growth) {
    room.config_.densify.max_growth = growth;
    const auto trainer = room.make(2);
    std::int64_t surfels = 0;
    while (trainer->iteration() < 40) surfels = trainer->step().surfels;
    return surfels;
  };
  EXPECT_GT(surfels_with_growth(0.1), surfels_with_growth(0.0) + 100);
}

TEST(GeometryTraining, LearnsTheExposureOfEachView) {
  SmallRoom room;
  room.start_ = *room.truth_;
  room.config_.densify.max_growth = 0.0;
  room.config_.rate.exposure = 0.02;
  for (std::size_t i = 0; i < room.set_.training.size(); i += 2) {
    for (core::Rgb8& pixel : room.set_.training[i].rgb.pixels()) {
      pixel.r = static_cast<std::uint8_t>(0.6 * pixel.r);
    }
  }
  const auto trainer = room.make(2);
  while (trainer->iteration() < 112) (void)trainer->step();
  const std::vector<Exposure> exposures = trainer->exposures();
  ASSERT_EQ(exposures.size(), room.set_.training.size());
  // Of a middle grey: gain and offset do the same to it.
  const auto bright = [&](std::size_t view, int c) {
    return 0.4F * exposures[view].gain[c] + exposures[view].offset[c];
  };
  double darker = 0.0, plain = 0.0, green = 0.0;
  for (std::size_t i = 0; i + 1 < exposures.size(); i += 2) {
    darker += bright(i, 0);
    plain += bright(i + 1, 0);
    green += bright(i, 1) / bright(i + 1, 1);
  }
  EXPECT_LT(darker / plain, 0.75);
  EXPECT_NEAR(green / (0.5 * static_cast<double>(exposures.size())), 1.0, 0.05);
  room.config_.rate.exposure = 0.0;
  EXPECT_TRUE(room.make()->exposures().empty());
}

TEST(GeometryTraining, ThreadsDoNotMatter) {
  const SmallRoom room;
  const auto one = room.make(1), two = room.make(2);
  for (int i = 0; i < 20; ++i) {
    (void)one->step();
    (void)two->step();
  }
  expect_same(one->surfels(), two->surfels());
}

TEST(GeometryTraining, GoesOnAsIfItHadNeverStopped) {
  SmallRoom room;
  room.config_.rate.exposure = 0.001;
  room.config_.rate.pose_rotation = room.config_.rate.pose_translation = 1e-3;
  const tests::TemporaryFolder folder("geometry_training");
  const auto file = folder.path() / "geometry.state";
  const auto whole = room.make();
  // In the middle of statistics, before and after the count changes.
  for (int i = 0; i < 40; ++i) {
    (void)whole->step();
    if (i == 16) whole->save(file, "this run");
  }
  const auto resumed = room.make();
  resumed->load(file, "this run");
  EXPECT_EQ(resumed->iteration(), 17);
  while (resumed->iteration() < 40) (void)resumed->step();
  expect_same(whole->surfels(), resumed->surfels());
  for (std::size_t i = 0; i < room.set_.training.size(); ++i) {
    EXPECT_EQ(whole->poses()[i].translation_m(), resumed->poses()[i].translation_m());
    EXPECT_EQ(whole->poses()[i].rotation(), resumed->poses()[i].rotation());
  }
  EXPECT_GT(pose_change(room.poses(), resumed->poses()).mean_m, 1e-5);

  EXPECT_THROW(resumed->load(file, "another run"), core::InputError);
  EXPECT_THROW(resumed->load(folder.path() / "nothing", "this run"), core::InputError);
}

/// Moves every second pose somewhere, and the one after it the other way, so that the mean
/// stays: 1 cm and 0.5 degrees.
void disturb(std::vector<TrainingView>& views) {
  core::RandomStream random(8, "disturb");
  const auto unit = [&] {
    return glm::normalize(glm::dvec3(random.normal(), random.normal(), random.normal()));
  };
  for (std::size_t i = 0; i + 1 < views.size(); i += 2) {
    const glm::dvec3 way_m = 0.01 * unit();
    const glm::dvec3 axis = unit();
    for (const double sign : {1.0, -1.0}) {
      core::CameraPose& pose = views[i + (sign > 0.0 ? 0 : 1)].T_world_camera;
      pose = {glm::angleAxis(sign * 0.5 * 3.14159265358979 / 180.0, axis) * pose.rotation(),
              pose.translation_m() + sign * way_m};
    }
  }
}

TEST(GeometryTraining, RefinesPosesThatAreOff) {
  SmallRoom room;
  const std::vector<core::CameraPose> truth = room.poses();
  disturb(room.set_.training);
  const PoseChange before = pose_change(truth, room.poses());
  EXPECT_NEAR(before.mean_m, 0.01, 1e-6);
  EXPECT_NEAR(before.mean_rad, 0.5 * 3.14159265358979 / 180.0, 1e-6);
  // Surfels that are nearly right and move gently: else they learn the wrong poses first.
  room.start_ = *room.truth_;
  core::RandomStream random(1, "off");
  for (glm::vec3& p_m : room.start_.position_m) {
    for (int axis = 0; axis < 3; ++axis)
      p_m[axis] += static_cast<float>(0.003 * random.normal());
  }
  GeometryConfig::Rate& rate = room.config_.rate;
  rate.color = 0.0025;
  for (double* value : {&rate.position, &rate.position_final, &rate.opacity, &rate.log_scale,
                        &rate.rotation, &rate.color_rest}) {
    *value *= 0.1;
  }
  // The renderer's depth of these rough walls is not the mean depth that is trained.
  room.config_.loss.depth = room.config_.loss.normal = 0.0;
  room.config_.iterations = 320;
  room.config_.densify.max_growth = 0.0;
  const auto as_recorded = room.make(2);
  rate.pose_rotation = rate.pose_translation = 3e-3;
  const auto refining = room.make(2);
  for (std::int64_t i = 0; i < room.config_.iterations; ++i) {
    (void)as_recorded->step();
    (void)refining->step();
  }
  EXPECT_EQ(pose_change(room.poses(), as_recorded->poses()).largest_m, 0.0);
  const PoseChange after = pose_change(truth, refining->poses());
  EXPECT_LT(after.mean_m, 0.65 * before.mean_m);
  EXPECT_LT(after.mean_rad, 0.4 * before.mean_rad);
  // At the true poses of views that were not trained on.
  const double plain_db = room.held_out(as_recorded->surfels()).color.psnr_db();
  const double refined_db = room.held_out(refining->surfels()).color.psnr_db();
  EXPECT_GT(refined_db, plain_db + 1.5) << plain_db << " dB without";
}

TEST(PoseAlignment, FindsTheTruePosesOfOtherViews) {
  SmallRoom room;
  const auto poses_of = [](const std::vector<TrainingView>& views) {
    std::vector<core::CameraPose> poses;
    for (const TrainingView& view : views) poses.push_back(view.T_world_camera);
    return poses;
  };
  const auto truth = poses_of(room.set_.held_out);
  disturb(room.set_.held_out);
  const PoseChange before = pose_change(truth, poses_of(room.set_.held_out));
  std::int64_t reported = 0;
  const auto aligned =
      align_views(room.set_.held_out, room.set_.intrinsics, *room.truth_, room.config_,
                  {.threads = 2}, [&](std::int64_t done, std::int64_t) { reported = done; });
  const PoseChange after = pose_change(truth, aligned);
  EXPECT_LT(after.mean_m, 0.2 * before.mean_m);
  EXPECT_LT(after.mean_rad, 0.2 * before.mean_rad);
  EXPECT_EQ(reported, static_cast<std::int64_t>(room.set_.held_out.size()));
}

/// As after start_from_cloud(): no frame has depth.
TEST(GeometryTraining, ViewsWithoutDepthTrainOnColorAlone) {
  SmallRoom room;
  for (TrainingView& view : room.set_.training) view.depth_m = {};
  room.config_.densify.max_growth = 0.0;
  const auto trainer = room.make(2);
  double normal = 0.0;
  while (trainer->iteration() < room.config_.iterations) {
    const GeometryStep step = trainer->step();
    EXPECT_EQ(step.depth, 0.0);
    normal += step.normal;
  }
  EXPECT_GT(normal, 0.0);  // Of the surfels' own depth.
  EXPECT_GT(room.held_out(trainer->surfels()).color.psnr_db(),
            room.held_out(room.start_).color.psnr_db() + 5.0);
  renderer::check_surfels(trainer->surfels());
}

TEST(GeometryTraining, LossThatIsNoNumberLeavesTheSurfels) {
  SmallRoom room;
  const auto trainer = room.make();
  (void)trainer->step();
  const renderer::SurfelCloud before = trainer->surfels();
  room.config_.loss.depth = INFINITY;
  const auto broken = room.make();
  try {
    (void)broken->step();
    FAIL() << "no error";
  } catch (const core::InputError& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("iteration 1"));
  }
  EXPECT_EQ(broken->iteration(), 0);
  EXPECT_EQ(broken->surfels().position_m, room.start_.position_m);
}

TEST(GeometryTraining, HolesAreFilled) {
  SmallRoom room;
  // Everything in half of the room is missing.
  renderer::SurfelCloud part;
  for (std::size_t i = 0; i < room.start_.size(); ++i) {
    if (room.start_.position_m[i].x > 3.5F) continue;
    part.position_m.push_back(room.start_.position_m[i]);
    part.R_world_surfel.push_back(room.start_.R_world_surfel[i]);
    part.scale_m.push_back(room.start_.scale_m[i]);
    part.opacity.push_back(room.start_.opacity[i]);
    part.sh.push_back(room.start_.sh[i]);
  }
  room.start_ = part;
  room.config_.densify.max_growth = 0.0;
  room.config_.densify.max_surfels = 20000;
  const auto filling = room.make();
  room.config_.densify.fill_holes = false;
  const auto not_filling = room.make();
  for (int i = 0; i < 30; ++i) {
    (void)filling->step();
    (void)not_filling->step();
  }
  EXPECT_GT(filling->surfels().size(), part.size() + 100);
  EXPECT_LE(not_filling->surfels().size(), part.size());
  const double before = room.held_out(part).depth.completeness();
  EXPECT_LT(before, 0.95);
  EXPECT_GT(room.held_out(filling->surfels()).depth.completeness(),
            before + 0.5 * (1.0 - before));
}

TEST(ViewOfIteration, EveryViewOnceAnEpoch) {
  std::vector<std::size_t> first, second;
  for (std::int64_t i = 0; i < 7; ++i) first.push_back(view_of_iteration(i, 7, 1));
  for (std::int64_t i = 7; i < 14; ++i) second.push_back(view_of_iteration(i, 7, 1));
  EXPECT_EQ(std::set<std::size_t>(first.begin(), first.end()).size(), 7U);
  EXPECT_EQ(std::set<std::size_t>(second.begin(), second.end()).size(), 7U);
  EXPECT_NE(first, second);
}

TEST(TrainingDevice, CudaMustBeThere) {
#ifndef SEGSIM_WITH_CUDA_TRAINING
  EXPECT_THROW((void)make_training_rasterizer({.backend = renderer::Backend::kCuda}),
               core::InputError);
#endif
  EXPECT_FALSE(trains_on_gpu({.backend = renderer::Backend::kCpu}));
}

}  // namespace
}  // namespace segsim::reconstruction
