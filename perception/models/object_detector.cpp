#include "perception/models/object_detector.h"

#include <algorithm>
#include <fstream>
#include <set>

#include "core/error.h"
#include "core/input/regular_file.h"
#include "perception/models/internal/detectors.h"

namespace segsim::perception {

std::unique_ptr<core::Detector> load_object_detector(const std::filesystem::path& model,
                                                     const ObjectDetectorOptions& options) {
  const ModelDescription description = read_model_description(model);
  switch (description.task) {
    case ModelTask::kYolo:
      return make_yolo(description, options);
    case ModelTask::kGroundingDino:
      return make_grounding_dino(description, options);
    default:
      throw core::InputError::expected(description.place, "task yolo | grounding-dino",
                                       "a model of another task");
  }
}

bool is_foreign_detector(const std::filesystem::path& file) {
  if (!core::can_be_read(file)) return false;  // Who reads it as weights says what is wrong.
  std::ifstream stream(file, std::ios::binary);
  std::string start(7, '\0');
  stream.read(start.data(), static_cast<std::streamsize>(start.size()));
  return stream && start != "SEGSIMW";
}

bool needs_prompt(const std::filesystem::path& model) {
  return read_model_description(model).task == ModelTask::kGroundingDino;
}

std::vector<std::string> parse_prompt(const std::string& prompt) {
  std::vector<std::string> phrases;
  std::set<std::string> seen;
  for (std::size_t start = 0; start <= prompt.size();) {
    const std::size_t end = std::min(prompt.find('.', start), prompt.size());
    std::string phrase = prompt.substr(start, end - start);
    const auto blank = [](char c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r'; };
    while (!phrase.empty() && blank(phrase.back())) phrase.pop_back();
    phrase.erase(phrase.begin(), std::find_if_not(phrase.begin(), phrase.end(), blank));
    for (char& c : phrase) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
    start = end + 1;
    if (phrase.empty()) continue;
    if (!seen.insert(phrase).second) {
      throw core::InputError::expected("prompt", "each phrase once", "'" + phrase + "' again");
    }
    phrases.push_back(std::move(phrase));
  }
  if (phrases.empty()) {
    throw core::InputError::expected("prompt", "phrases like \"chair. table.\"",
                                     "'" + prompt + "'");
  }
  return phrases;
}

}  // namespace segsim::perception
