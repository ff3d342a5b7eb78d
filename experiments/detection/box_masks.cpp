#include "experiments/detection/box_masks.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"
#include "core/formatted.h"
#include "core/progress.h"
#include "experiments/drawing/box_picture.h"
#include "experiments/drawing/frame_picture.h"
#include "experiments/support/text_grid.h"
#include "perception/detector/detector.h"
#include "perception/models/object_detector.h"
#include "reconstruction/datasets/mask_files.h"

namespace segsim::experiments::detection {
namespace {

namespace fs = std::filesystem;
using core::InputError;
using reconstruction::RoomPart;

constexpr const char* kRecipeFile = "recipe.txt";

/// The class of that name; a new one behind all others if there is none.
std::uint16_t class_named(const std::string& name, bool thing,
                          std::vector<core::SceneClass>& table) {
  std::uint16_t last = 0;
  for (const core::SceneClass& c : table) {
    if (c.name == name) return c.id;
    last = std::max(last, c.id);
  }
  table.push_back({static_cast<std::uint16_t>(last + 1), name, thing});
  return table.back().id;
}

std::uint8_t byte_of(float score) {
  return static_cast<std::uint8_t>(std::lround(std::clamp(score, 0.0F, 1.0F) * 255.0F));
}

void set(core::FrameMasks& masks, std::size_t i, std::uint16_t class_id, std::uint16_t id,
         std::uint8_t confidence) {
  masks.semantic.pixels()[i] = class_id;
  masks.instance.pixels()[i] = id;
  masks.confidence.pixels()[i] = confidence;
}

std::vector<std::size_t> by_descending_score(const std::vector<core::Detection>& detections) {
  std::vector<std::size_t> order(detections.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return detections[a].score > detections[b].score;
  });
  return order;
}

/// Those that show mostly something that no surer mask shows, by descending score.
std::vector<std::size_t> visible_masks(const std::vector<core::Detection>& detections,
                                       const std::vector<core::Image<std::uint8_t>>& masks,
                                       std::size_t pixels) {
  std::vector<std::uint8_t> taken(pixels);
  std::vector<std::size_t> kept;
  for (const std::size_t k : by_descending_score(detections)) {
    std::size_t all = 0, hidden = 0;
    for (std::size_t i = 0; i < pixels; ++i) {
      if (masks[k].pixels()[i] == 0) continue;
      ++all;
      hidden += taken[i];
    }
    if (all == 0 || 2 * hidden > all) continue;
    for (std::size_t i = 0; i < pixels; ++i) {
      if (masks[k].pixels()[i] != 0) taken[i] = 1;
    }
    kept.push_back(k);
  }
  return kept;
}

/// The settings of the masks that are there, or nothing. A set that is complete, or one of
/// other settings, is not gone on with.
void prepare_folder(const fs::path& folder, const std::string& recipe) {
  const fs::path file = folder / kRecipeFile;
  if (fs::exists(file)) {
    const std::string before = core::read_file(file);
    if (before != recipe + "\n") {
      throw InputError::expected(folder.string(), "a new folder, or masks of the same recipe",
                                 before.substr(0, before.find('\n')));
    }
    return;
  }
  core::write_file_atomically(file, [&](std::ostream& stream) { stream << recipe << '\n'; });
}

std::vector<std::string> stated_things(const std::string& prompt) {
  return prompt.empty() ? std::vector<std::string>{} : perception::parse_prompt(prompt);
}

struct ViewTools {
  core::Detector& detector;
  const reconstruction::RoomParts* room;  ///< Null: not wanted.
  const BoxMaskClasses& classes;
  const BoxMaskOptions& options;
};

core::FrameMasks masks_of_view(const reconstruction::RgbdFrame& frame,
                               const core::CameraIntrinsics& intrinsics,
                               const ViewTools& tools) {
  const int width = frame.rgb.width_px(), height = frame.rgb.height_px();
  core::Observation observation;
  observation.intrinsics = intrinsics;
  observation.rgb = &frame.rgb;
  const std::vector<core::Detection> found = tools.detector.detect(observation);
  const core::Image<float> depth_m =
      reconstruction::depth_of_size(frame.depth_m, width, height);
  core::Image<RoomPart> parts(width, height, RoomPart::kNone);
  if (tools.room != nullptr && !depth_m.empty()) {
    parts = tools.room->of_view(depth_m, intrinsics, frame.T_world_camera);
  }
  const reconstruction::BoxSegmenter segmenter(frame.rgb, depth_m, parts, intrinsics.fx_px,
                                               tools.options.segmenter);
  std::vector<core::Image<std::uint8_t>> masks;
  masks.reserve(found.size());
  for (const core::Detection& detection : found)
    masks.push_back(segmenter.segment(detection.box));
  return paint_box_masks(found, masks, parts, depth_m, tools.classes, tools.options.scores);
}

}  // namespace

BoxMaskClasses box_mask_classes(const std::vector<std::string>& detected,
                                const std::vector<core::SceneClass>& recorded, bool room,
                                bool other) {
  BoxMaskClasses classes;
  classes.table = recorded;
  for (const std::string& name : detected) {
    const bool taken = (room && (name == "floor" || name == "wall" || name == "ceiling")) ||
                       (other && name == "other");
    if (taken) {
      throw InputError::expected(
          "--prompt", "classes of things (" + name + " is found without a detector)",
          "'" + name + "'");
    }
    classes.of_class.push_back(class_named(name, true, classes.table));
  }
  if (room) {
    classes.floor = class_named("floor", false, classes.table);
    classes.wall = class_named("wall", false, classes.table);
    classes.ceiling = class_named("ceiling", false, classes.table);
  }
  if (other) classes.other = class_named("other", false, classes.table);
  std::vector<std::uint16_t> used = classes.of_class;
  used.insert(used.end(), {classes.floor, classes.wall, classes.ceiling, classes.other});
  std::erase_if(classes.table, [&](const core::SceneClass& c) {
    return std::find(used.begin(), used.end(), c.id) == used.end();
  });
  std::sort(classes.table.begin(), classes.table.end(),
            [](const auto& a, const auto& b) { return a.id < b.id; });
  return classes;
}

core::FrameMasks paint_box_masks(const std::vector<core::Detection>& detections,
                                 const std::vector<core::Image<std::uint8_t>>& masks,
                                 const core::Image<RoomPart>& parts,
                                 const core::Image<float>& depth_m,
                                 const BoxMaskClasses& classes, const RoomScores& scores) {
  SEGSIM_CHECK(detections.size() == masks.size(), "one mask per detection");
  core::FrameMasks result;
  const int width = parts.width_px(), height = parts.height_px();
  result.semantic = core::Image<std::uint16_t>(width, height);
  result.instance = core::Image<std::uint16_t>(width, height);
  result.confidence = core::Image<std::uint8_t>(width, height);
  for (const auto& mask : masks) {
    SEGSIM_CHECK(mask.width_px() == width && mask.height_px() == height,
                 "masks of the image's size");
  }
  for (std::size_t i = 0; i < parts.size(); ++i) {
    std::uint16_t id = 0;
    switch (parts.pixels()[i]) {
      case RoomPart::kFloor:
        id = classes.floor;
        break;
      case RoomPart::kWall:
        id = classes.wall;
        break;
      case RoomPart::kCeiling:
        id = classes.ceiling;
        break;
      case RoomPart::kNone:
        break;
    }
    if (id != 0) {
      set(result, i, id, 0, byte_of(scores.room));
    } else if (classes.other != 0 && !depth_m.empty() && depth_m.pixels()[i] > 0.0F) {
      set(result, i, classes.other, 0, byte_of(scores.other));
    }
  }
  const std::vector<std::size_t> kept = visible_masks(detections, masks, parts.size());
  for (std::size_t rank = kept.size(); rank-- > 0;) {
    const core::Detection& of = detections[kept[rank]];
    const auto& inside = masks[kept[rank]].pixels();
    for (std::size_t i = 0; i < inside.size(); ++i) {
      if (inside[i] == 0) continue;
      set(result, i, classes.of_class.at(static_cast<std::size_t>(of.class_index)),
          static_cast<std::uint16_t>(rank + 1), std::max<std::uint8_t>(1, byte_of(of.score)));
    }
  }
  result.segments = core::segments_of(result);
  return result;
}

std::unique_ptr<core::Detector> open_detector(const fs::path& file, const std::string& prompt,
                                              std::optional<float> score_threshold) {
  if (!fs::is_regular_file(file)) {
    throw InputError::expected(
        "--detector " + file.string(),
        "weights of this program, a YOLO as .onnx or TorchScript, or a description (.yaml)",
        "no such file");
  }
  const std::vector<std::string> wanted = stated_things(prompt);
  if (perception::is_foreign_detector(file)) {
    if (wanted.empty() && perception::needs_prompt(file)) {
      throw InputError::expected("--prompt",
                                 "phrases like \"chair. couch.\", for this detector has no "
                                 "classes of its own",
                                 "none");
    }
    perception::ObjectDetectorOptions options;
    options.prompts = wanted;
    options.score_threshold = score_threshold;
    return perception::load_object_detector(file, options);
  }
  perception::DetectorOptions options;
  options.score_threshold = score_threshold;
  auto detector = perception::load_detector(file, options);
  if (!wanted.empty() && wanted != detector->class_names()) {
    throw InputError::expected("--prompt", "none: " + file.string() + " finds all its classes",
                               "'" + prompt + "'");
  }
  return detector;
}

std::string describe(const BoxMaskOptions& options,
                     const reconstruction::RgbdSequence& recording) {
  const auto number = [](double v) { return core::print("%g", v); };
  const reconstruction::BoxSegmenterOptions& s = options.segmenter;
  const reconstruction::RoomPartOptions& r = options.parts;
  std::string text = "box masks 1; recording " + recording.name() + ", " +
                     std::to_string(recording.frame_count()) + " frames, every " +
                     std::to_string(options.frame_step) + "; detector sha256 " +
                     core::sha256_of_file(options.detector) + "; prompt '" + options.prompt +
                     "'; threshold " +
                     (options.score_threshold ? number(*options.score_threshold) : "its own");
  text += options.room ? "; room " + number(options.scores.room) : std::string("; no room");
  text +=
      options.other ? "; other " + number(options.scores.other) : std::string("; no other");
  text += "; segmenter";
  for (const double v :
       {s.depth_step, static_cast<double>(s.bridge_px), s.grow, s.inside_share,
        s.foreign_share, s.depth_margin, static_cast<double>(s.rounds),
        static_cast<double>(s.longest_px), s.least_fill}) {
    text += " " + number(v);
  }
  text += "; parts";
  for (const double v :
       {r.floor_band_m, r.ceiling_above_m, r.wall_top_m, r.wall_area_m2, r.plane_distance_m,
        r.gap_m, r.distance_m, r.distance_per_depth, r.least_cosine}) {
    text += " " + number(v);
  }
  return text;
}

reconstruction::RoomParts find_room_parts(const reconstruction::RgbdSequence& recording,
                                          const reconstruction::RoomPartOptions& options) {
  constexpr std::size_t kMostFrames = 240;
  constexpr int kColumns = 120;
  const std::size_t count = std::min(kMostFrames, recording.frame_count());
  reconstruction::FacingPoints points;
  core::Progress progress("find floor and walls", static_cast<std::int64_t>(count));
  for (std::size_t k = 0; k < count; ++k) {
    const reconstruction::RgbdFrame frame =
        recording.load(k * recording.frame_count() / count);
    if (!frame.depth_m.empty()) {
      points.add_view(
          frame.depth_m,
          recording.intrinsics().resized(frame.depth_m.width_px(), frame.depth_m.height_px()),
          frame.T_world_camera, std::max(1, frame.depth_m.width_px() / kColumns));
    }
    progress.update(static_cast<std::int64_t>(k) + 1);
  }
  progress.finish();
  if (points.empty()) {
    throw InputError::expected(recording.name(), "frames with depth (or --no-room)", "none");
  }
  return reconstruction::RoomParts(points.elements(), options);
}

BoxMaskReport make_box_masks(const reconstruction::RgbdSequence& recording,
                             const BoxMaskOptions& options) {
  SEGSIM_CHECK(options.frame_step >= 1, std::to_string(options.frame_step));
  const auto detector =
      open_detector(options.detector, options.prompt, options.score_threshold);
  const BoxMaskClasses classes = box_mask_classes(detector->class_names(), recording.classes(),
                                                  options.room, options.other);
  const std::string recipe = describe(options, recording);
  prepare_folder(options.output, recipe);
  fs::remove(options.output / "masks.yaml");  // Until the set is complete again.
  BoxMaskReport report;
  std::optional<reconstruction::RoomParts> room;
  if (options.room) {
    room.emplace(find_room_parts(recording, options.parts));
  }
  const ViewTools tools{*detector, room ? &*room : nullptr, classes, options};
  const auto step = static_cast<std::size_t>(options.frame_step);
  std::map<std::uint16_t, std::size_t> count_of;
  core::Progress progress(
      "make masks", static_cast<std::int64_t>((recording.frame_count() + step - 1) / step));
  for (std::size_t i = 0; i < recording.frame_count(); i += step) {
    const std::string& name = recording.frame_name(i);
    if (fs::exists(options.output / (name + ".json"))) {  // Written last of a view.
      ++report.kept;
    } else {
      reconstruction::write_masks(
          options.output, name,
          masks_of_view(recording.load(i), recording.intrinsics(), tools), classes.table);
    }
    progress.update(static_cast<std::int64_t>(++report.views));
  }
  progress.finish();
  reconstruction::MaskSetInfo info;
  info.source = "boxes of " + options.detector.filename().string() +
                ", cut out by depth and colour, of " + recording.name();
  info.classes = classes.table;
  info.prompts = stated_things(options.prompt);
  info.settings = {{"room_score", options.room ? options.scores.room : 0.0},
                   {"other_score", options.other ? options.scores.other : 0.0}};
  if (options.score_threshold) {
    info.settings.emplace_back("score_threshold", *options.score_threshold);
  }
  reconstruction::write_mask_set_info(options.output, info);

  const auto written = reconstruction::open_masks(options.output);
  for (std::size_t i = 0; i < recording.frame_count(); i += step) {
    for (const auto& segment : written->read_as_stored(recording.frame_name(i)).segments) {
      ++count_of[segment.class_id];
    }
  }
  report.classes = classes.table;
  for (const core::SceneClass& c : classes.table) report.masks.push_back(count_of[c.id]);
  return report;
}

void remove_box_masks(const fs::path& folder) {
  if (!fs::exists(folder / kRecipeFile)) {
    if (!reconstruction::is_mask_set(folder)) return;
    throw InputError::expected(
        folder.string(),
        "masks that `segsim masks make` made, with " + std::string(kRecipeFile),
        "masks of another origin");
  }
  fs::remove(folder / "masks.yaml");
  constexpr const char* kEndings[] = {"_sem.png", "_ins.png", "_conf.png", ".json"};
  std::vector<fs::path> views;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    for (const char* ending : kEndings) {
      if (name.ends_with(ending)) views.push_back(entry.path());
    }
  }
  for (const fs::path& file : views) fs::remove(file);
  fs::remove(folder / kRecipeFile);
}

core::Image<core::Rgb8> box_mask_sheet(const reconstruction::RgbdSequence& recording,
                                       const fs::path& masks, int frame_step, int views) {
  SEGSIM_CHECK(frame_step >= 1 && views >= 1, "positive counts");
  const auto set = reconstruction::open_masks(masks);
  const auto step = static_cast<std::size_t>(frame_step);
  const std::size_t all = (recording.frame_count() + step - 1) / step;
  const std::size_t shown = std::min(all, static_cast<std::size_t>(views));
  std::vector<std::string> names;
  for (const core::SceneClass& c : set->info().classes) {
    names.resize(std::max<std::size_t>(names.size(), std::size_t{c.id} + 1));
    names[c.id] = c.name;
  }
  std::vector<drawing::SheetPicture> pictures;
  for (std::size_t k = 0; k < shown; ++k) {
    const std::size_t i = (2 * k + 1) * all / (2 * shown) * step;
    const reconstruction::RgbdFrame frame = recording.load(i);
    const core::FrameMasks view =
        set->read(recording.frame_name(i), frame.rgb.width_px(), frame.rgb.height_px());
    core::Frame labels;
    labels.semantic = view.semantic;
    labels.instance = view.instance;
    const core::Image<core::Rgb8> colours = drawing::panoptic_picture(labels);
    core::Image<core::Rgb8> picture = frame.rgb;
    for (std::size_t p = 0; p < picture.size(); ++p) {
      if (view.semantic.pixels()[p] == 0) continue;
      core::Rgb8& c = picture.pixels()[p];
      const core::Rgb8& over = colours.pixels()[p];
      c = {static_cast<std::uint8_t>((c.r + over.r) / 2),
           static_cast<std::uint8_t>((c.g + over.g) / 2),
           static_cast<std::uint8_t>((c.b + over.b) / 2)};
    }
    std::vector<perception::LabeledBox> boxes;
    for (const core::MaskSegment& segment : view.segments) {
      if (segment.id == 0) continue;
      perception::LabeledBox box;
      box.class_index = segment.class_id;
      box.box = segment.box;
      boxes.push_back(box);
    }
    pictures.push_back(
        {drawing::draw_boxes(picture, boxes, {}, names, 1.0), recording.frame_name(i)});
  }
  return drawing::picture_sheet(pictures, 3, set->info().source);
}

}  // namespace segsim::experiments::detection
