#include "experiments/detection/open_vocabulary_masks.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/check.h"
#include "core/error.h"
#include "core/progress.h"
#include "perception/models/object_detector.h"
#include "reconstruction/datasets/mask_files.h"

namespace segsim::experiments::detection {
namespace {

namespace fs = std::filesystem;
using core::InputError;

void paint(core::FrameMasks& masks, const core::Image<std::uint8_t>& inside,
           const core::MaskSegment& segment) {
  const auto confidence =
      static_cast<std::uint8_t>(std::lround(std::clamp(segment.score, 0.0F, 1.0F) * 255.0F));
  for (std::size_t i = 0; i < inside.size(); ++i) {
    if (inside.pixels()[i] == 0) continue;
    masks.semantic.pixels()[i] = segment.class_id;
    masks.instance.pixels()[i] = segment.id;
    masks.confidence.pixels()[i] = confidence;
  }
}

}  // namespace

core::FrameMasks compose_masks(int width_px, int height_px,
                               const std::vector<core::Detection>& detections,
                               const std::vector<perception::PromptMask>& masks,
                               const std::vector<core::SceneClass>& classes) {
  SEGSIM_CHECK(detections.size() == masks.size(), "one mask per detection");
  core::FrameMasks result;
  result.semantic = core::Image<std::uint16_t>(width_px, height_px);
  result.instance = core::Image<std::uint16_t>(width_px, height_px);
  result.confidence = core::Image<std::uint8_t>(width_px, height_px);
  std::vector<std::size_t> order(detections.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return detections[a].score > detections[b].score;
  });
  std::vector<core::MaskSegment> segments;
  for (const std::size_t i : order) {
    SEGSIM_CHECK(
        masks[i].inside.width_px() == width_px && masks[i].inside.height_px() == height_px,
        "masks of the image's size");
    const auto& of = classes.at(static_cast<std::size_t>(detections[i].class_index));
    core::MaskSegment segment;
    segment.class_id = of.id;
    segment.id = of.thing ? static_cast<std::uint16_t>(segments.size() + 1) : std::uint16_t{0};
    segment.score = detections[i].score;
    segments.push_back(segment);
  }
  for (std::size_t k = order.size(); k-- > 0;) {
    paint(result, masks[order[k]].inside, segments[k]);
  }
  result.segments = core::segments_of(result);
  return result;
}

std::vector<core::SceneClass> prompt_classes(const std::vector<std::string>& phrases,
                                             const std::vector<std::string>& stuff,
                                             const std::vector<core::SceneClass>& recorded,
                                             const std::string& place) {
  for (const std::string& word : stuff) {
    if (std::find(phrases.begin(), phrases.end(), word) == phrases.end()) {
      throw InputError::expected("--stuff", "phrases of the prompt", "'" + word + "'");
    }
  }
  std::vector<core::SceneClass> classes;
  for (const std::string& phrase : phrases) {
    core::SceneClass entry;
    entry.id = static_cast<std::uint16_t>(classes.size() + 1);
    entry.name = phrase;
    entry.thing = std::find(stuff.begin(), stuff.end(), phrase) == stuff.end();
    if (!recorded.empty()) {
      const auto known = std::find_if(recorded.begin(), recorded.end(),
                                      [&](const auto& c) { return c.name == phrase; });
      if (known == recorded.end()) {
        throw InputError::expected(place, "phrases that are classes of the recording",
                                   "'" + phrase + "'");
      }
      entry = *known;
    }
    classes.push_back(std::move(entry));
  }
  return classes;
}

DetectMasksReport detect_masks(const reconstruction::RgbdSequence& recording,
                               const DetectMasksOptions& options) {
  perception::ObjectDetectorOptions detector_options;
  detector_options.prompts = perception::parse_prompt(options.prompt);
  detector_options.score_threshold = options.score_threshold;
  const std::vector<std::string> stuff = options.stuff.empty()
                                             ? std::vector<std::string>{}
                                             : perception::parse_prompt(options.stuff);
  const auto classes =
      prompt_classes(detector_options.prompts, stuff, recording.classes(), "--prompt");
  const auto detector = perception::load_object_detector(options.detector, detector_options);
  const auto segmenter = perception::load_prompt_segmenter(options.segmenter);
  fs::remove(options.output / "masks.yaml");  // Until the set is complete again.
  const auto step = static_cast<std::size_t>(options.frame_step);
  DetectMasksReport report;
  core::Progress progress(
      "detect masks", static_cast<std::int64_t>((recording.frame_count() + step - 1) / step));
  for (std::size_t i = 0; i < recording.frame_count(); i += step) {
    const reconstruction::RgbdFrame frame = recording.load(i);
    core::Observation observation;
    observation.intrinsics = recording.intrinsics();
    observation.rgb = &frame.rgb;
    const std::vector<core::Detection> found = detector->detect(observation);
    std::vector<core::BoxPx> boxes;
    boxes.reserve(found.size());
    for (const core::Detection& detection : found) boxes.push_back(detection.box);
    const core::FrameMasks masks =
        compose_masks(frame.rgb.width_px(), frame.rgb.height_px(), found,
                      segmenter->segment(frame.rgb, boxes), classes);
    reconstruction::write_masks(options.output, recording.frame_name(i), masks, classes);
    report.masks += masks.segments.size();
    progress.update(static_cast<std::int64_t>(++report.views));
  }
  progress.finish();
  reconstruction::MaskSetInfo info;
  info.source = "detector " + options.detector.filename().string() + ", segmenter " +
                options.segmenter.filename().string() + ", of " + recording.name();
  info.classes = classes;
  std::sort(info.classes.begin(), info.classes.end(),
            [](const auto& a, const auto& b) { return a.id < b.id; });
  info.prompts = detector_options.prompts;
  reconstruction::write_mask_set_info(options.output, info);
  return report;
}

}  // namespace segsim::experiments::detection
