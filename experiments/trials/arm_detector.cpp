#include "experiments/trials/arm_detector.h"

#include <algorithm>
#include <filesystem>
#include <optional>

#include "experiments/trials/python_peer.h"
#include "peers/peer.h"
#include "perception/detector/detector.h"
#include "perception/models/object_detector.h"

namespace segsim::experiments::trials {
namespace {

/// Classes that are searched for in a scene, by the spec or by its episodes: those of phrases
/// are known to these alone.
std::vector<std::string> goal_names(const LoadedScene& scene) {
  std::vector<std::string> names = scene.spec->goals;
  if (!names.empty() && scene.spec->phrases.empty()) return names;
  for (const std::string& name : unknown_goals(searched_classes(scene), names)) {
    names.push_back(name);
  }
  return names;
}

std::unique_ptr<core::Detector> load_foreign(const std::filesystem::path& file,
                                             std::optional<float> score_threshold,
                                             const LoadedScene& scene) {
  perception::ObjectDetectorOptions options;
  options.score_threshold = score_threshold;
  if (perception::needs_prompt(file)) options.prompts = goal_names(scene);
  return perception::load_object_detector(file, options);
}

}  // namespace

perception::ComputeDevice compute_device(const specs::ExperimentSpec& spec) {
  return spec.backend == renderer::Backend::kCuda ? perception::ComputeDevice::kCuda
                                                  : perception::ComputeDevice::kCpu;
}

bool is_prompted(const specs::ArmSpec& arm) {
  return arm.detector == specs::ArmDetector::kFile &&
         perception::is_foreign_detector(arm.weights) && perception::needs_prompt(arm.weights);
}

std::shared_ptr<peers::Peer> detector_process(const specs::ArmSpec& arm,
                                              const LoadedScene& scene) {
  if (arm.detector != specs::ArmDetector::kProcess) return nullptr;
  return std::make_shared<peers::Peer>(runnable(arm.process), "detector", goal_names(scene));
}

std::unique_ptr<core::Detector> load_arm_detector(const specs::ArmSpec& arm,
                                                  const PreparedDetectors& detectors,
                                                  const LoadedScene& scene,
                                                  perception::ComputeDevice device) {
  if (auto process = detector_process(arm, scene)) {
    return peers::make_peer_detector(std::move(process));
  }
  const std::filesystem::path file = weights_of(arm, scene.spec->name, detectors).file;
  std::optional<float> threshold;
  if (arm.score_threshold) threshold = static_cast<float>(*arm.score_threshold);
  if (!perception::is_foreign_detector(file)) {
    perception::DetectorOptions options;
    options.score_threshold = threshold;
    options.device = device;
    return perception::load_detector(file, options);
  }
  return load_foreign(file, threshold, scene);
}

std::unique_ptr<core::Detector> load_open_detector(const specs::ArmSpec& arm,
                                                   const LoadedScene& scene) {
  return load_foreign(arm.open_detector, std::nullopt, scene);
}

std::vector<std::string> searched_classes(const LoadedScene& scene) {
  std::vector<std::string> names;
  for (const sim::Episode& episode : scene.episodes.episodes) {
    names.push_back(episode.class_name);
  }
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

std::vector<std::string> unknown_goals(const std::vector<std::string>& goals,
                                       const std::vector<std::string>& known) {
  std::vector<std::string> unknown = goals;
  std::erase_if(unknown, [&](const std::string& name) {
    return std::find(known.begin(), known.end(), name) != known.end();
  });
  return unknown;
}

}  // namespace segsim::experiments::trials
