#include "experiments/trials/policy_models.h"

#include <algorithm>
#include <array>
#include <span>

#include "core/check.h"
#include "experiments/ros2/ros2_policy.h"
#include "experiments/trials/python_peer.h"
#include "nav/mapping/depth_inference.h"
#include "nav/objects/segmenter.h"
#include "nav/policies/built_in_policies.h"
#include "nav/value/image_text_scorer.h"
#include "perception/models/depth_estimator.h"
#include "perception/models/image_text_scorer.h"
#include "perception/models/prompt_segmenter.h"

namespace segsim::experiments::trials {
namespace {

/// The model's score of the image and the prompt. A cosine below 0 promises nothing.
class ModelScorer final : public nav::ImageTextScorer {
 public:
  ModelScorer(const std::filesystem::path& model, std::string prompt)
      : model_(perception::load_image_text_scorer(model)), prompt_(std::move(prompt)) {}

  double score(const core::Observation& observation,
               std::span<const core::Detection> /*detections*/,
               const core::ObjectGoal& target) override {
    SEGSIM_CHECK(observation.rgb != nullptr, "a model scores colours");
    std::string text = prompt_;
    text.replace(text.find("{}"), 2, target.text());
    return std::clamp(static_cast<double>(model_->scores(*observation.rgb, {text}).front()),
                      0.0, 1.0);
  }

 private:
  std::unique_ptr<perception::ImageTextScorer> model_;
  std::string prompt_;
};

class ModelSegmenter final : public nav::Segmenter {
 public:
  explicit ModelSegmenter(const std::filesystem::path& model)
      : model_(perception::load_prompt_segmenter(model)) {}

  core::Image<std::uint8_t> segment(const core::Observation& observation,
                                    const core::BoxPx& box) override {
    SEGSIM_CHECK(observation.rgb != nullptr, "a model segments colours");
    const std::array<core::BoxPx, 1> boxes{box};
    return std::move(model_->segment(*observation.rgb, boxes).front().inside);
  }

 private:
  std::unique_ptr<perception::PromptSegmenter> model_;
};

class ModelDepth final : public nav::DepthInference {
 public:
  explicit ModelDepth(const std::filesystem::path& model)
      : model_(perception::load_depth_estimator(model)) {}

  void infer(const core::Observation& observation, core::Image<float>& depth_m) override {
    SEGSIM_CHECK(observation.rgb != nullptr, "a model infers depth from colours");
    model_->infer(*observation.rgb, depth_m);
  }

 private:
  std::unique_ptr<perception::DepthEstimator> model_;
};

/// Null if the policy has none.
const nav::ScorerSettings* scorer_of(const nav::PolicyChoice& policy) {
  if (const auto* vlfm = policy.settings<nav::VlfmSettings>()) return &vlfm->scorer;
  if (const auto* value = policy.settings<nav::FrontierValueSettings>()) return &value->scorer;
  return nullptr;
}

}  // namespace

std::vector<std::filesystem::path> model_files(const nav::PolicyChoice& policy) {
  std::vector<std::filesystem::path> files;
  const nav::ScorerSettings* scorer = scorer_of(policy);
  if (scorer != nullptr && !scorer->model.empty()) files.push_back(scorer->model);
  const auto* vlfm = policy.settings<nav::VlfmSettings>();
  if (vlfm != nullptr && !vlfm->segmenter.empty()) files.push_back(vlfm->segmenter);
  if (vlfm != nullptr && !vlfm->depth.empty()) files.push_back(vlfm->depth);
  return files;
}

void LoadedPolicyModels::load(const nav::PolicyChoice& policy) {
  const nav::PolicyModels load = loaders();
  const nav::ScorerSettings* scorer = scorer_of(policy);
  if (scorer != nullptr && !scorer->model.empty()) load.scorer(scorer->model, scorer->prompt);
  const auto* vlfm = policy.settings<nav::VlfmSettings>();
  if (vlfm != nullptr && !vlfm->segmenter.empty()) load.segmenter(vlfm->segmenter);
  if (vlfm != nullptr && !vlfm->depth.empty()) load.depth(vlfm->depth);
  if (const auto* other = policy.settings<nav::ProcessSettings>())
    process(other->peer)->start();
  if (const auto* network = policy.settings<nav::Ros2Settings>()) (void)robot(*network);
}

std::shared_ptr<peers::Peer> LoadedPolicyModels::process(const core::PeerCommand& command) {
  for (const auto& [known, peer] : processes_) {
    if (known == command) return peer;
  }
  auto peer = std::make_shared<peers::Peer>(runnable(command), "policy");
  return processes_.emplace_back(command, std::move(peer)).second;
}

std::shared_ptr<ros2::RobotNode> LoadedPolicyModels::robot(const nav::Ros2Settings& settings) {
  for (const auto& [known, node] : robots_) {
    if (known == settings) return node;
  }
  // One network sees one robot: those of other arms leave it.
  std::erase_if(robots_,
                [&](const auto& other) { return other.first.domain == settings.domain; });
  return robots_.emplace_back(settings, std::make_shared<ros2::RobotNode>(settings)).second;
}

nav::PolicyModels LoadedPolicyModels::loaders() {
  nav::PolicyModels models;
  models.scorer = [this](const std::filesystem::path& model, const std::string& prompt) {
    std::shared_ptr<nav::ImageTextScorer>& scorer = scorers_[{model, prompt}];
    if (scorer == nullptr) scorer = std::make_shared<ModelScorer>(model, prompt);
    return scorer;
  };
  models.segmenter = [this](const std::filesystem::path& model) {
    std::shared_ptr<nav::Segmenter>& segmenter = segmenters_[model];
    if (segmenter == nullptr) segmenter = std::make_shared<ModelSegmenter>(model);
    return segmenter;
  };
  models.depth = [this](const std::filesystem::path& model) {
    std::shared_ptr<nav::DepthInference>& depth = depths_[model];
    if (depth == nullptr) depth = std::make_shared<ModelDepth>(model);
    return depth;
  };
  models.process = [this](const core::PeerCommand& command,
                          const nav::PolicyContext& context) {
    peers::EpisodeStart start;
    start.class_names = context.class_names;
    start.robot = context.robot;
    start.camera_height_m = context.camera_height_m;
    return peers::make_peer_policy(process(command), std::move(start));
  };
  models.ros2 = [this](const nav::Ros2Settings& settings, const nav::PolicyContext& context) {
    return std::make_unique<ros2::Ros2Policy>(robot(settings), settings, context.class_names);
  };
  return models;
}

}  // namespace segsim::experiments::trials
