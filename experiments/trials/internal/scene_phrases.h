#pragma once

/// @file
/// What the phrases among the goals of a scene mean: asked once of the scene as it is judged,
/// and kept.

#include <filesystem>
#include <functional>
#include <memory>
#include <vector>

#include "core/render.h"
#include "core/scene_bundle.h"
#include "experiments/episodes/episodes.h"
#include "experiments/specs/spec.h"

namespace segsim::experiments::trials {

/// Looks at all things of the scene through the spec's image-text model (scene_query.h) and
/// takes those that fit each phrase best. Scores and picture are kept in
/// ${work}/phrases/<scene>.json and .png, and used again as long as scene, model, phrases and
/// views are the same.
/// @param make_eye  Renders the bundle; called if there is something to look at.
/// @throws core::InputError if a phrase means nothing, or fewer things than it should.
[[nodiscard]] std::vector<episodes::PhraseGoal> scene_phrases(
    const specs::ExperimentSpec& spec, const specs::SceneSpec& scene,
    const core::SceneBundle& bundle, const std::filesystem::path& work,
    const std::function<std::unique_ptr<core::Renderer>()>& make_eye);

}  // namespace segsim::experiments::trials
