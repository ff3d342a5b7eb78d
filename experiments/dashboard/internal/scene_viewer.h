#pragma once

/// @file
/// Pictures of scenes and of finished trials, drawn when a page asks for them.

#include <cstdint>
#include <filesystem>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "core/render.h"
#include "core/scene_bundle.h"
#include "experiments/drawing/floor_plan.h"
#include "experiments/records/trial_log.h"
#include "experiments/results/stored_run.h"
#include "experiments/scenes/scene_surfels.h"

namespace segsim::experiments::dashboard::internal {

/// Points of a scene for a 3-D view, at most so many.
inline constexpr std::size_t kMostPoints = 100'000;

/// Little endian: a 32-bit number n, then n x 3 floats (World, m), then n x 3 bytes (sRGB),
/// then n x 3 bytes (colour of the class).
[[nodiscard]] std::string point_bytes(const renderer::SurfelCloud& surfels,
                                      std::size_t most = kMostPoints);

/// What one image of a trial shows.
enum class TrialImage : std::uint8_t { kCamera, kPanoptic };

/// Thread-safe: one drawing at a time. Keeps the last scenes, logs and images.
class SceneViewer {
 public:
  /// @throws core::InputError if the bundle is not there or damaged (all functions).
  [[nodiscard]] std::string floor_json(const std::filesystem::path& bundle);
  [[nodiscard]] std::string floor_jpeg(const std::filesystem::path& bundle);
  [[nodiscard]] std::string points(const std::filesystem::path& bundle);

  /// @throws core::InputError if the trial has no log.
  [[nodiscard]] std::shared_ptr<const records::TrialLog> log(const results::StoredRun& stored,
                                                             const records::TrialRow& trial);
  /// What the camera saw at a tick, drawn again from the true pose; goal objects outlined.
  /// @throws core::InputError for a tick that is not there.
  [[nodiscard]] std::string trial_image(const results::StoredRun& stored,
                                        const records::TrialRow& trial, std::size_t tick,
                                        TrialImage which);

 private:
  struct Scene {
    core::SceneBundle bundle;
    scenes::SceneSurfels surfels;
    drawing::FloorPlan plan;
    core::Image<core::Rgb8> floor;  ///< The plan, reduced.
    std::unique_ptr<core::Renderer> renderer;
  };
  /// Holds mutex_.
  Scene& scene(const std::filesystem::path& bundle);

  std::mutex mutex_;                                           // Guards what follows.
  std::list<std::pair<std::filesystem::path, Scene>> scenes_;  ///< Newest first.
  std::list<std::pair<std::string, std::shared_ptr<const records::TrialLog>>> logs_;
  std::list<std::pair<std::string, std::string>> images_;
};

/// Where the bundle of a log lies.
[[nodiscard]] std::filesystem::path bundle_of(const results::StoredRun& stored,
                                              const records::TrialLog& log);

}  // namespace segsim::experiments::dashboard::internal
