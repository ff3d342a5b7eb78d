#pragma once

/// @file
/// The scene of a bundle with labels that are learnt anew from masks of its recording. Shape,
/// colour, cameras and floor are those of the bundle, so that both are the same place seen by
/// two who know it unequally well: a trial is judged by the labels of the one, and a detector
/// learns from those of the other.

#include <filesystem>
#include <string>

#include "core/scene_bundle.h"
#include "experiments/training/training_run.h"
#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::experiments::scenes {

struct RelabelOptions {
  /// Its masks are those to learn from; of its settings those of the labels count. Frames are
  /// held out as its `set` says.
  training::TrainingOptions training;
  std::string masks;  ///< What they are, in words; the manifest's source tells them.
};

/// Writes the relabelled bundle; an existing one is replaced.
/// @param recording  That the bundle was made from, with the same frame names.
/// @throws core::InputError for a bundle without cameras, or a recording that lacks a view of
///     the bundle.
core::SceneBundle relabel_bundle(const core::SceneBundle& bundle,
                                 const reconstruction::RgbdSequence& recording,
                                 const RelabelOptions& options,
                                 const std::filesystem::path& folder);

}  // namespace segsim::experiments::scenes
