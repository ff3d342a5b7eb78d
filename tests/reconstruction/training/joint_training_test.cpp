#include "reconstruction/training/joint_training.h"

#include <cmath>
#include <filesystem>
#include <memory>
#include <numeric>

#include <gtest/gtest.h>

#include "reconstruction/training/training_views.h"
#include "tests/reconstruction/labels/label_scene.h"

namespace segsim::reconstruction {
namespace {

namespace fs = std::filesystem;
using testing::LabelScene;
using testing::OwnedGradients;
using testing::OwnedImages;
using testing::OwnedSurfels;

constexpr std::int64_t kView = 7;  ///< No wall is before the boxes.

/// Loss of a trained head's labels in one view as the surfels decide about it.
class LabelLoss {
 public:
  explicit LabelLoss(const std::string& head_name)
      : surfels_(testing::parameters_of<double>(scene_.cloud())), name_(head_name) {
    config_.iterations = 60;
    config_.sampling.max_surfels_per_pixel = 0;
    const auto head = scene_.train(name_, config_);
    head->save(file_);
    config_.rate.scale = 1e-9;
    for (std::int32_t p = 0; p < 80 * 60; p += 7) pixels_.push_back(p);
  }
  ~LabelLoss() { fs::remove(file_); }
  LabelLoss(const LabelLoss&) = delete;
  LabelLoss& operator=(const LabelLoss&) = delete;

  OwnedSurfels<double>& surfels() { return surfels_; }
  /// [surfels, 3]: how far a surfel is from there as the head's queries see it.
  std::vector<double>& offset_m() { return offset_m_; }
  [[nodiscard]] const std::vector<double>& by_offset() const { return by_offset_; }

  /// @param gradients  Also the derivatives, if not null.
  double value(OwnedGradients<double>* gradients) {
    PanopticHeadInputs inputs = scene_.inputs(name_, config_, 1);
    for (std::size_t i = 0; i < inputs.position_m.size(); ++i) {
      const double *p = &surfels_.position_m[3 * i], *d = &offset_m_[3 * i];
      inputs.position_m[i] = glm::vec3(p[0] + d[0], p[1] + d[1], p[2] + d[2]);
    }
    const auto head = make_panoptic_head(name_, inputs, config_, 1);
    head->load(file_);
    OwnedImages<double> images(scene_.camera);
    rasterizer_->forward(surfels_.view(), scene_.camera, scene_.T_world_camera(kView),
                         images.view(), nullptr);
    PanopticBatch batch;
    batch.frame = kView;
    batch.weights =
        rasterizer_->weights(pixels_.data(), static_cast<std::int64_t>(pixels_.size()), 0);
    std::vector<std::uint16_t> semantic, instance;
    for (const std::int32_t p : pixels_) {
      semantic.push_back(scene_.masks(kView).semantic.data()[p]);
      instance.push_back(scene_.masks(kView).instance.data()[p]);
    }
    batch.semantic = semantic.data();
    batch.instance = instance.data();
    GeometryGradient gradient;
    if (gradients != nullptr) batch.gradient = &gradient;
    const double loss = head->step(batch, config_.iterations - 1).back().value;
    if (gradients == nullptr) return loss;
    rasterizer_->add_weight_loss(pixels_, batch.weights, gradient.by_weight.data());
    rasterizer_->backward(surfels_.view(), OwnedImages<double>(scene_.camera).const_view(),
                          gradients->view());
    for (std::size_t i = 0; i < gradient.by_position.size(); ++i) {
      const auto at = 3 * static_cast<std::size_t>(gradient.surfel[i / 3]) + i % 3;
      gradients->position_m[at] += static_cast<double>(gradient.by_position[i]);
      by_offset_[at] = static_cast<double>(gradient.by_position[i]);
    }
    return loss;
  }

 private:
  LabelScene scene_;
  PanopticTrainingConfig config_ = LabelScene::config();
  OwnedSurfels<double> surfels_;
  std::vector<double> offset_m_ = std::vector<double>(surfels_.position_m.size(), 0.0);
  std::vector<double> by_offset_ = offset_m_;
  std::string name_;
  fs::path file_ = fs::path(::testing::TempDir()) / "joint_training.state";
  std::vector<std::int32_t> pixels_;
  std::unique_ptr<DifferentiableRasterizer<double>> rasterizer_ =
      make_cpu_rasterizer<double>({1});
};

class JointHeads : public ::testing::TestWithParam<std::string> {};

TEST_P(JointHeads, DerivativesOfLabelLossesReachTheSurfels) {
  LabelLoss loss(GetParam());
  OwnedGradients<double> gradients(loss.surfels());
  loss.value(&gradients);
  // Uphill. Where edges of surfels pass pixels, their weight jumps by 1/255, which the
  // rasterizer's derivative leaves out: about a tenth of the rise. Its own tests are exact.
  const auto compare = [&](const char* name, std::vector<double>& parameter,
                           const std::vector<double>& gradient, double step,
                           double tolerance) {
    double length2 = 0.0, largest = 0.0;
    for (const double g : gradient) length2 += g * g, largest = std::max(largest, std::abs(g));
    ASSERT_GT(largest, 1e-4) << name;
    const std::vector<double> kept = parameter;
    const auto value_at = [&](double factor) {
      for (std::size_t i = 0; i < kept.size(); ++i) {
        parameter[i] = kept[i] + factor * gradient[i];
      }
      const double value = loss.value(nullptr);
      parameter = kept;
      return value;
    };
    const double factor = step / largest;
    const double rise = (value_at(factor) - value_at(-factor)) / (2.0 * factor);
    EXPECT_NEAR(rise, length2, tolerance * length2) << name;
  };
  compare("offset", loss.offset_m(), loss.by_offset(), 2e-3, 0.02);
  compare("position", loss.surfels().position_m, gradients.position_m, 2e-3, 0.2);
  compare("log_scale", loss.surfels().log_scale, gradients.log_scale, 0.02, 0.2);
  compare("opacity_logit", loss.surfels().opacity_logit, gradients.opacity_logit, 0.2, 0.2);
}

INSTANTIATE_TEST_SUITE_P(Names, JointHeads, ::testing::ValuesIn(joint_head_names()),
                         [](const auto& case_info) {
                           std::string name = case_info.param;
                           for (char& c : name) c = std::isalpha(c) != 0 ? c : '_';
                           return name;
                         });

/// A grey plate; what is left of x = 0 is a table and the rest a wall. Columns of surfels lie
/// 8 cm apart, and the border runs through one of them.
class Border {
 public:
  Border() {
    testing::add_plate(cloud_, {-0.86F, -0.8F, 0.0F}, {1.6F, 0, 0}, {0, 1.6F, 0}, 2, 0);
    set_.intrinsics = core::CameraIntrinsics::from_fov(64, 48, 1.0);
    set_.classes = testing::label_scene_classes();
    const auto renderer =
        renderer::make_cpu_renderer(std::make_shared<const renderer::SurfelCloud>(cloud_));
    for (int i = 0; i < 12; ++i) {
      const core::CameraPose pose =
          core::look_at({0.25 * std::cos(0.5 * i), -0.3 + 0.05 * i, 1.2}, {0.0, 0.1, 0.0});
      TrainingView view;
      view.frame = static_cast<std::size_t>(i);
      view.name = "view " + std::to_string(i);
      view.T_world_camera = pose;
      const core::Frame drawn = renderer->render(pose, set_.intrinsics, core::Channels::kRgbd);
      view.rgb = drawn.rgb;
      view.depth_m = drawn.depth_m;
      view.masks = truth(pose);
      (i % 4 == 3 ? set_.held_out : set_.training).push_back(std::move(view));
    }
  }

  /// Share of wrong pixels on views that were not trained on.
  double error(bool joint, int threads = 1) {
    PanopticTrainingConfig config = LabelScene::config();
    config.iterations = 240;
    config.sampling.max_surfels_per_pixel = 0;
    GeometryConfig geometry;
    geometry.iterations = 0;
    geometry.sh_degree = 0;
    const GeometryDevice device{.threads = threads};
    GeometryTrainer trainer(set_, cloud_, geometry, 1, device);
    std::unique_ptr<PanopticViews> views;
    PanopticTrainingRun run{.config = config,
                            .classes = set_.classes,
                            .seed = 1,
                            .on_progress = {},
                            .on_checkpoint = {}};
    if (joint) {
      auto moving = make_joint_views(set_, trainer, {.labels = 1.0}, device);
      run.moving = moving.get();
      views = std::move(moving);
    } else {
      views = make_training_views(set_, cloud_, device);
    }
    PanopticHeadInputs inputs{.position_m = cloud_.position_m,
                              .R_world_surfel = cloud_.R_world_surfel,
                              .classes = set_.classes,
                              .query_seeds = {},
                              .object_of_mask = {},
                              .object_class = {},
                              .frames = views->count()};
    prepare_head_inputs("query", *views, config, 1, inputs);
    const auto head = make_panoptic_head("query", inputs, config, 1);
    train_panoptic(*views, *head, run);
    surfels_ = trainer.surfels();
    return wrong_pixels(head->result().field);
  }
  [[nodiscard]] const renderer::SurfelCloud& surfels() const { return surfels_; }

 private:
  [[nodiscard]] core::FrameMasks truth(const core::CameraPose& pose) const {
    core::FrameMasks masks;
    const int width = set_.intrinsics.width_px, height = set_.intrinsics.height_px;
    masks.semantic = core::Image<std::uint16_t>(width, height);
    masks.instance = core::Image<std::uint16_t>(width, height);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const glm::dvec3 ray =
            pose.rotation() * set_.intrinsics.back_project({x + 0.5, y + 0.5}, 1.0);
        const glm::dvec3 eye = pose.translation_m();
        const bool table = eye.x - ray.x * eye.z / ray.z < 0.0;
        masks.semantic(x, y) = table ? 4 : 2;
        masks.instance(x, y) = table ? 1 : 0;
      }
    }
    return masks;
  }

  [[nodiscard]] double wrong_pixels(const renderer::PanopticField& field) const {
    const auto renderer = renderer::make_cpu_renderer(
        std::make_shared<const renderer::SurfelCloud>(surfels_), {.top_k = 8, .threads = 1},
        std::make_shared<const renderer::PanopticField>(field));
    double wrong = 0.0, all = 0.0;
    for (const TrainingView& view : set_.held_out) {
      const core::Frame frame =
          renderer->render(view.T_world_camera, set_.intrinsics, core::Channels::kLabels);
      for (std::size_t i = 0; i < frame.semantic.size(); ++i) {
        if (frame.semantic.data()[i] == 0) continue;  // Beside the plate.
        wrong += frame.semantic.data()[i] != view.masks.semantic.data()[i] ? 1.0 : 0.0;
        all += 1.0;
      }
    }
    return wrong / all;
  }

  renderer::SurfelCloud cloud_, surfels_;
  TrainingSet set_;
};

TEST(JointTraining, ABorderThatRunsThroughSurfelsGetsBetter) {
  Border border;
  const double frozen = border.error(/*joint=*/false);
  const double joint = border.error(/*joint=*/true);
  EXPECT_GT(frozen, 0.01);
  EXPECT_LT(joint, 0.6 * frozen);
}

TEST(JointTraining, DoesNotDependOnTheNumberOfThreads) {
  Border one, many;
  const double error = many.error(true, 3);  // First: TBB keeps the lowest number it was told.
  EXPECT_EQ(one.error(true, 1), error);
  EXPECT_EQ(one.surfels().position_m, many.surfels().position_m);
  EXPECT_EQ(one.surfels().opacity, many.surfels().opacity);
}

}  // namespace
}  // namespace segsim::reconstruction
