#pragma once

/// @file
/// What the tests of model adapters share. The models are small and have the signatures of the
/// real ones; each graph computes its answer from the picture or the prompt, so pre- and
/// post-processing are seen through it.

#include <filesystem>
#include <string>
#include <vector>

#include "core/file_io.h"
#include "core/stages.h"
#include "tests/error_message.h"

namespace segsim::perception {

inline std::vector<core::Detection> detect(core::Detector& detector,
                                           const core::Image<core::Rgb8>& image) {
  core::Observation observation;
  observation.rgb = &image;
  return detector.detect(observation);
}

inline void write_text(const std::filesystem::path& file, const std::string& text) {
  core::write_file_atomically(file, [&](std::ostream& out) { out << text; });
}

inline constexpr const char* kVocabulary =
    "[PAD]\n[UNK]\n[CLS]\n[SEP]\n.\nchair\noffice\ntable\n##s\n";  // 0 to 8

}  // namespace segsim::perception
