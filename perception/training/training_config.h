#pragma once

/// @file
/// The options of training by network: defaults, and the YAML file that changes them.
/// training_defaults.yaml lists all keys, in one section for each network; a file given by the
/// user may name any subset of them.

#include <filesystem>
#include <string>
#include <vector>

#include "perception/training/training.h"

namespace segsim::perception {

/// "small", "yolov13n", "yolov13s", "yolov13l", "yolov13x",
/// "centernet".
[[nodiscard]] const std::vector<std::string>& train_models();

/// As in a weights file (weights_file.h). @throws core::InputError for another name.
[[nodiscard]] std::string architecture_of_model(const std::string& model);
/// The inverse. @throws core::InputError that starts with `place`.
[[nodiscard]] std::string model_of_architecture(const std::string& architecture,
                                                const std::string& place);

/// Everything but files and classes as published for the network, or as this project chose it
/// for the small one. @throws core::InputError for an unknown model.
[[nodiscard]] TrainOptions default_train_options(const std::string& model);

/// Sets what the section of `options.model` ("small", "yolov13" or "centernet") names.
/// @returns the keys that it names.
/// @throws core::InputError naming file, line and key.
std::vector<std::string> read_train_config(const std::filesystem::path& file,
                                           TrainOptions& options);

/// If the optimiser is AdamW: `momentum` (its first beta) and `warmup_bias_rate` as
/// Optimizer::kAuto sets them, except those of `named_keys`. The defaults of YOLOv13 for both
/// are meant for SGD.
void fit_to_adamw(TrainOptions& options, const std::vector<std::string>& named_keys);

/// All keys of training_defaults.yaml with their values, as one JSON object: two runs with
/// equal text, data and start make equal weights.
[[nodiscard]] std::string describe_train_options(const TrainOptions& options);

}  // namespace segsim::perception
