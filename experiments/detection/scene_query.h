#pragma once

/// @file
/// Which objects of a scene fit a phrase: an image-text model (docs/models.md) looks at
/// several rendered views of each.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/render.h"
#include "core/scene_bundle.h"
#include "perception/models/image_text_scorer.h"

namespace segsim::experiments::detection {

struct SceneQueryOptions {
  int views = 4;        ///< Of each object: those that show most of it.
  int directions = 12;  ///< Tried, all around it.
  double camera_height_m = 1.2;
  int width_px = 320, height_px = 240;
  double hfov_deg = 70.0;
  int least_px = 200;    ///< Of the object in a view; a view that shows less is none.
  double margin = 0.25;  ///< Around the object in its crop, of its larger side.
};

/// An object and how well it fits each phrase.
struct QueriedInstance {
  std::uint16_t id = 0;
  std::string name, class_name;
  glm::dvec3 centre_m{0.0};         ///< World frame.
  int views = 0;                    ///< Used; 0: no camera saw it, and it has no scores.
  std::vector<double> scores;       ///< One for each phrase: mean over views and both crops.
  core::Image<core::Rgb8> picture;  ///< The crop of the view that shows most of it.
};

/// Scores all things of the scene. In each view the object is cut out twice, with what is
/// around it and alone on grey, because models were trained on whole pictures and an object's
/// neighbours mislead them.
/// @param renderer  Of the bundle, with labels. @param on_instance  Done, of so many.
/// @throws core::InputError if the scene has no thing.
[[nodiscard]] std::vector<QueriedInstance> query_scene(
    core::Renderer& renderer, const core::SceneManifest& manifest,
    perception::ImageTextScorer& scorer, const std::vector<std::string>& phrases,
    const SceneQueryOptions& options = {},
    const std::function<void(int, int)>& on_instance = nullptr);

/// Indices of `instances` from the best to the worst for a phrase; those without a view are
/// left out.
[[nodiscard]] std::vector<std::size_t> ranking(const std::vector<QueriedInstance>& instances,
                                               std::size_t phrase);

/// What a phrase means: the `count` things that fit it best among those of one class, which is
/// that of the best of all. Fewer if the scene has no more; none if no thing has a score.
[[nodiscard]] std::vector<std::size_t> meant_by(const std::vector<QueriedInstance>& instances,
                                                std::size_t phrase, int count);

/// For each phrase a table of the best things. @param most  Of each phrase.
[[nodiscard]] std::string query_text(const std::vector<QueriedInstance>& instances,
                                     const std::vector<std::string>& phrases, int most);

/// What was asked of a scene, and the answers (without their pictures).
struct SceneQuery {
  std::string model;  ///< File name of its description.
  std::vector<std::string> phrases;
  std::vector<QueriedInstance> instances;
};
/// As JSON, `segsim.scene_query/1`.
void write_query(const std::filesystem::path& file, const SceneQuery& query);
/// @throws core::InputError if it is no such file.
[[nodiscard]] SceneQuery read_query(const std::filesystem::path& file);

/// The best of each phrase in a row, with their scores. @param most  Of each phrase.
[[nodiscard]] core::Image<core::Rgb8> query_picture(
    const std::vector<QueriedInstance>& instances, const std::vector<std::string>& phrases,
    int most);

}  // namespace segsim::experiments::detection
