#pragma once

/// @file
/// A small flat for label training: a floor, two walls and seven boxes of three classes, with
/// views all around, exact masks whose ids are shuffled in every view, and strict evaluation
/// on views between them.

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <numbers>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "core/random.h"
#include "reconstruction/evaluation/panoptic_quality.h"
#include "reconstruction/labels/panoptic_training.h"
#include "renderer/cpu_renderer.h"
#include "tests/reconstruction/training/training_surfels.h"
#include "tests/renderer/scenes.h"

namespace segsim::reconstruction::testing {

inline std::vector<core::SceneClass> label_scene_classes() {
  return {{1, "floor", false},
          {2, "wall", false},
          {3, "chair", true},
          {4, "table", true},
          {5, "tv", true}};
}

/// A rectangle of surfels: corner + a u + b v, a, b in [0, 1].
inline void add_plate(renderer::SurfelCloud& cloud, const glm::vec3& corner,
                      const glm::vec3& u, const glm::vec3& v, std::uint16_t semantic,
                      std::uint16_t instance) {
  constexpr float kSpacing_m = 0.08F;
  const int nu = std::max(1, static_cast<int>(std::lround(glm::length(u) / kSpacing_m)));
  const int nv = std::max(1, static_cast<int>(std::lround(glm::length(v) / kSpacing_m)));
  for (int i = 0; i < nu; ++i) {
    for (int j = 0; j < nv; ++j) {
      const float a = (static_cast<float>(i) + 0.5F) / static_cast<float>(nu);
      const float b = (static_cast<float>(j) + 0.5F) / static_cast<float>(nv);
      renderer::testing::add(
          cloud,
          {.position_m = corner + a * u + b * v,
           .R_world_surfel = renderer::testing::facing(glm::normalize(glm::cross(u, v))),
           .scale_m = glm::vec2(0.7F * kSpacing_m),
           .opacity = 0.95F,
           .colour = glm::vec3(0.5F),
           .semantic = semantic,
           .instance = instance});
    }
  }
}

inline void add_box(renderer::SurfelCloud& cloud, const glm::vec3& lo, const glm::vec3& size,
                    std::uint16_t semantic, std::uint16_t instance) {
  const glm::vec3 x(size.x, 0, 0), y(0, size.y, 0), z(0, 0, size.z);
  add_plate(cloud, lo + z, x, y, semantic, instance);
  add_plate(cloud, lo, x, z, semantic, instance);
  add_plate(cloud, lo, y, z, semantic, instance);
  add_plate(cloud, lo + y, x, z, semantic, instance);
  add_plate(cloud, lo + x, y, z, semantic, instance);
}

inline renderer::SurfelCloud label_scene_cloud() {
  renderer::SurfelCloud cloud;
  add_plate(cloud, {-2.0F, -2.0F, 0.0F}, {4.0F, 0, 0}, {0, 4.0F, 0}, 1, 0);
  add_plate(cloud, {-2.0F, 2.0F, 0.0F}, {4.0F, 0, 0}, {0, 0, 1.5F}, 2, 0);
  add_plate(cloud, {2.0F, -2.0F, 0.0F}, {0, 4.0F, 0}, {0, 0, 1.5F}, 2, 0);
  add_box(cloud, {-1.2F, -1.0F, 0.0F}, {0.4F, 0.4F, 0.6F}, 3, 1);
  add_box(cloud, {-1.2F, -0.3F, 0.0F}, {0.4F, 0.4F, 0.6F}, 3, 2);
  add_box(cloud, {-1.2F, 0.4F, 0.0F}, {0.4F, 0.4F, 0.6F}, 3, 3);
  add_box(cloud, {0.0F, -0.6F, 0.0F}, {0.9F, 0.6F, 0.5F}, 4, 4);
  add_box(cloud, {0.2F, 0.7F, 0.0F}, {0.9F, 0.6F, 0.5F}, 4, 5);
  add_box(cloud, {0.3F, -0.5F, 0.5F}, {0.3F, 0.3F, 0.3F}, 5, 6);
  add_box(cloud, {0.4F, 0.8F, 0.5F}, {0.3F, 0.3F, 0.3F}, 5, 7);
  return cloud;
}

/// Views on a circle. Training views are even numbers of twice as many places, test views odd.
inline core::CameraPose label_scene_pose(int place, int places) {
  const double angle = 2.0 * std::numbers::pi * place / places;
  return core::look_at({2.6 * std::cos(angle), 2.6 * std::sin(angle), 1.7}, {0.0, 0.0, 0.2});
}

class LabelScene : public PanopticViews {
 public:
  static constexpr int kViews = 12;
  const core::CameraIntrinsics camera = core::CameraIntrinsics::from_fov(80, 60, 1.2);

  LabelScene()
      : cloud_(std::make_shared<const renderer::SurfelCloud>(label_scene_cloud())),
        parameters_(parameters_of<float>(*cloud_)) {
    // One vote: class and instance of a pixel are of the same surfel.
    auto renderer = renderer::make_cpu_renderer(cloud_, {.top_k = 1, .threads = 1});
    for (int place = 0; place < 2 * kViews; ++place) {
      const core::CameraPose pose = label_scene_pose(place, 2 * kViews);
      core::Frame frame =
          renderer->render(pose, camera, core::Channels::kLabels | core::Channels::kDepth);
      (place % 2 == 0 ? training_ : test_).push_back(std::move(frame));
    }
    set_masks(1);
  }

  [[nodiscard]] const renderer::SurfelCloud& cloud() const { return *cloud_; }
  [[nodiscard]] std::vector<core::FrameMasks>& all_masks() { return masks_; }

  /// Exact masks; ids are shuffled in every view, and differently for every seed.
  void set_masks(std::uint64_t seed) {
    masks_.clear();
    for (const core::Frame& frame : training_) {
      core::RandomStream random(seed, "mask_ids", masks_.size());
      std::vector<std::uint16_t> ids(8);
      std::iota(ids.begin(), ids.end(), std::uint16_t{0});
      for (std::size_t i = 7; i > 1; --i) {
        std::swap(ids[i], ids[1 + random.index(static_cast<std::uint32_t>(i))]);
      }
      core::FrameMasks masks;
      masks.semantic = frame.semantic;
      masks.instance = frame.instance;
      for (auto& id : masks.instance.pixels()) id = ids[id];
      masks.confidence =
          core::Image<std::uint8_t>(camera.width_px, camera.height_px, std::uint8_t{255});
      masks_.push_back(std::move(masks));
    }
  }

  [[nodiscard]] std::int64_t count() const override { return kViews; }
  const core::FrameMasks& masks(std::int64_t view) override {
    return masks_[static_cast<std::size_t>(view)];
  }
  const core::Image<float>& depth_m(std::int64_t view) override {
    return training_[static_cast<std::size_t>(view)].depth_m;
  }
  [[nodiscard]] core::CameraIntrinsics intrinsics(std::int64_t) const override {
    return camera;
  }
  [[nodiscard]] core::CameraPose T_world_camera(std::int64_t view) const override {
    return training_[static_cast<std::size_t>(view)].T_world_camera;
  }
  PixelWeights weights(std::int64_t view, std::span<const std::int32_t> pixels,
                       int max_per_pixel, int slot) override {
    auto& rasterizer = rasterizers_[{view, slot}];
    if (!rasterizer) {
      rasterizer = make_cpu_rasterizer<float>({.threads = 1});
      OwnedImages<float> images(camera);
      rasterizer->forward(parameters_.view(), camera, T_world_camera(view), images.view(),
                          nullptr);
    }
    return rasterizer->weights(pixels.data(), static_cast<std::int64_t>(pixels.size()),
                               max_per_pixel);
  }

  /// Strict panoptic quality on the test views.
  [[nodiscard]] PanopticQuality evaluate(const renderer::PanopticField& field,
                                         int top_k = 4) const {
    auto renderer =
        renderer::make_cpu_renderer(cloud_, {.top_k = top_k, .threads = 1},
                                    std::make_shared<const renderer::PanopticField>(field));
    ContingencyTable table;
    for (const core::Frame& truth : test_) {
      const core::Frame frame =
          renderer->render(truth.T_world_camera, camera, core::Channels::kLabels);
      table.add_frame({truth.semantic, truth.instance}, {frame.semantic, frame.instance});
    }
    return panoptic_quality(table, label_scene_classes(), PanopticRules::strict());
  }

  /// A configuration that converges in 150 iterations on this scene.
  [[nodiscard]] static PanopticTrainingConfig config() {
    PanopticTrainingConfig config;
    config.iterations = 150;
    config.sampling.pixels = 1500;
    config.sampling.max_surfels_per_pixel = 8;
    config.rate.scale = 6.0;
    return config;
  }

  [[nodiscard]] PanopticHeadInputs inputs(const std::string& head_name,
                                          const PanopticTrainingConfig& config,
                                          std::uint64_t seed) {
    PanopticHeadInputs inputs{.position_m = cloud_->position_m,
                              .R_world_surfel = cloud_->R_world_surfel,
                              .classes = label_scene_classes(),
                              .query_seeds = {},
                              .object_of_mask = {},
                              .object_class = {},
                              .frames = kViews};
    prepare_head_inputs(head_name, *this, config, seed, inputs);
    return inputs;
  }

  std::unique_ptr<PanopticHead> train(const std::string& head_name,
                                      const PanopticTrainingConfig& config,
                                      std::uint64_t seed = 1) {
    auto head = make_panoptic_head(head_name, inputs(head_name, config, seed), config, seed);
    train_panoptic(*this, *head,
                   {.config = config,
                    .classes = label_scene_classes(),
                    .seed = seed,
                    .on_progress = {},
                    .on_checkpoint = {},
                    .warp = head_name == "panoptic-splatting"});
    return head;
  }

 private:
  std::shared_ptr<const renderer::SurfelCloud> cloud_;
  OwnedSurfels<float> parameters_;
  std::vector<core::Frame> training_, test_;
  std::vector<core::FrameMasks> masks_;
  std::map<std::pair<std::int64_t, int>, std::unique_ptr<DifferentiableRasterizer<float>>>
      rasterizers_;
};

}  // namespace segsim::reconstruction::testing
