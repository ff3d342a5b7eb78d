#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "core/bundle_parts.h"
#include "core/error.h"
#include "core/process/measurement_record.h"
#include "core/progress.h"
#include "core/scene_bundle.h"
#include "experiments/commands/detectors/detector_commands.h"
#include "experiments/commands/light/flag_values.h"
#include "experiments/drawing/frame_picture.h"
#include "experiments/scenes/scene_source.h"
#include "experiments/scenes/scene_surfels.h"
#include "experiments/support/record_file.h"
#include "experiments/support/text_grid.h"
#include "experiments/training/mask_quality.h"
#include "perception/data/image_file.h"
#include "reconstruction/datasets/mask_files.h"
#include "renderer/cpu_renderer.h"

namespace segsim::experiments::commands::detectors {
namespace {

namespace fs = std::filesystem;
using core::InputError;

struct TruthFlags {
  fs::path recording, boxes, label_map;
  std::string layout = "auto";
  std::optional<double> floor_height_m;
  int frame_step = 1;
};

struct SimulateFlags {
  TruthFlags truth;
  fs::path out, preview;
  double level = 1.0;
  std::uint64_t seed = 1;
  bool fit = false, overwrite = false;
};

struct MeasureFlags {
  TruthFlags truth;
  fs::path masks, record;
  int held_out_every = 0;
};

std::unique_ptr<reconstruction::RgbdSequence> open_truth(const TruthFlags& flags) {
  reconstruction::SequenceOptions options;
  options.layout = reconstruction::parse_sequence_layout(flags.layout, "--layout");
  options.label_map = flags.label_map;
  options.floor_height_m = flags.floor_height_m;
  auto recording = scenes::open_recording(flags.recording, flags.boxes, options);
  if (!recording->has_masks()) {
    throw InputError::expected(flags.recording.string(),
                               "exact labels (a capture, a labelled data set, or --boxes)",
                               "a recording without");
  }
  return recording;
}

/// Truth over masks.
core::Image<core::Rgb8> preview_picture(const training::TrueLabels& truth,
                                        const core::FrameMasks& masks) {
  const auto picture = [](const core::Image<std::uint16_t>& semantic,
                          const core::Image<std::uint16_t>& instance) {
    core::Frame frame;
    frame.semantic = semantic;
    frame.instance = instance;
    return drawing::panoptic_picture(frame);
  };
  const core::Image<core::Rgb8> above = picture(truth.semantic, truth.instance);
  const core::Image<core::Rgb8> below = picture(masks.semantic, masks.instance);
  core::Image<core::Rgb8> both(above.width_px(), 2 * above.height_px());
  const auto middle =
      std::copy(above.pixels().begin(), above.pixels().end(), both.pixels().begin());
  std::copy(below.pixels().begin(), below.pixels().end(), middle);
  return both;
}

void simulate(const SimulateFlags& flags) {
  if (fs::exists(flags.out / "masks.yaml") && !flags.overwrite) {
    throw InputError::expected(flags.out.string(), "a new folder, or --overwrite",
                               "a complete set of masks");
  }
  const auto recording = open_truth(flags.truth);
  training::MaskSimulation simulation;
  simulation.level = flags.level;
  simulation.fit = flags.fit;
  simulation.seed = flags.seed;
  simulation.frame_step = flags.truth.frame_step;
  const std::size_t step = static_cast<std::size_t>(flags.truth.frame_step);
  const std::size_t views = (recording->frame_count() + step - 1) / step;
  std::size_t done = 0;
  const training::MaskQuality quality = training::simulate_masks(
      *recording, simulation, flags.out,
      [&](const training::TrueLabels& truth, const core::FrameMasks& masks) {
        if (done++ == views / 2 && !flags.preview.empty()) {
          perception::write_image(flags.preview, preview_picture(truth, masks));
        }
      });
  std::printf("%s: masks of %zu views\n\n%s", flags.out.string().c_str(), views,
              training::mask_quality_text(training::describe(simulation), quality).c_str());
}

/// The views that masks are compared with.
struct Truth {
  std::string name;
  std::vector<core::SceneClass> classes;
  std::vector<std::string> views;
  std::function<training::TrueLabels(std::size_t)> load;
};

Truth truth_of_recording(const TruthFlags& flags) {
  const std::shared_ptr<reconstruction::RgbdSequence> recording = open_truth(flags);
  Truth truth{recording->name(), recording->classes(), {}, [recording](std::size_t i) {
                return training::load_true_labels(*recording, i);
              }};
  for (std::size_t i = 0; i < recording->frame_count(); ++i) {
    truth.views.push_back(recording->frame_name(i));
  }
  return truth;
}

/// Annotations of single views, whose ids mean nothing in the next one.
Truth truth_of_masks(const fs::path& folder) {
  const std::shared_ptr<reconstruction::MaskSet> masks = reconstruction::open_masks(folder);
  return {folder.filename().string(), masks->info().classes, masks->names(),
          [masks](std::size_t i) {
            const core::FrameMasks view = masks->read_as_stored(masks->names()[i]);
            return training::TrueLabels{view.semantic, view.instance,
                                        reconstruction::images_of(view).crowds,
                                        core::CameraPose(), static_cast<std::uint32_t>(i)};
          }};
}

/// Labels of the views that are compared with the truth, under the truth's classes.
struct Found {
  std::string source;  ///< In words.
  bool scene = false;  ///< Ids mean the same object in all views.
  training::ClassTranslation translation;
  std::function<bool(const std::string& view)> has;
  /// Of the truth's i-th view, whose name and size are given.
  std::function<training::TrueLabels(std::size_t i, int width_px, int height_px)> load;
  std::string example;  ///< Name of a view; empty without any.
};

Found found_in_masks(const fs::path& folder, const Truth& truth) {
  // With a table of its own, classes of equal name are the same; else ids are the truth's.
  const std::shared_ptr<reconstruction::MaskSet> masks = reconstruction::open_masks(
      folder,
      reconstruction::is_mask_set(folder) ? std::vector<core::SceneClass>{} : truth.classes);
  Found found;
  found.source = masks->info().source;
  found.translation = training::translate_classes(masks->info().classes, truth.classes);
  found.has = [masks](const std::string& view) {
    return std::binary_search(masks->names().begin(), masks->names().end(), view);
  };
  found.load = [masks, views = truth.views](std::size_t i, int width_px, int height_px) {
    core::FrameMasks view = masks->read(views[i], width_px, height_px);
    return training::TrueLabels{std::move(view.semantic), std::move(view.instance), {}, {}, 0};
  };
  if (!masks->names().empty()) found.example = masks->names().front();
  return found;
}

/// What the bundle's surfels show from where the recording's cameras were.
Found found_in_bundle(const fs::path& folder, const TruthFlags& flags, const Truth& truth) {
  const std::shared_ptr<reconstruction::RgbdSequence> recording = open_truth(flags);
  const core::SceneBundle bundle = core::load_bundle(folder);
  const core::SceneLevelling levelling = core::load_bundle_parts(folder).levelling;
  const scenes::SceneSurfels surfels = scenes::load_scene_surfels(bundle);
  if (bundle.manifest.classes.empty()) {
    throw InputError::expected(folder.string(), "a bundle with labels", "none");
  }
  const std::shared_ptr<core::Renderer> renderer =
      renderer::make_cpu_renderer(surfels.surfels, {}, surfels.labels);
  const core::Transform<core::frame::World, core::frame::World> T_world_source(
      levelling.R_world_source, levelling.p_world_source_m);
  Found found;
  found.source = bundle.manifest.source;
  found.scene = true;
  found.translation = training::translate_classes(bundle.manifest.classes, truth.classes);
  found.has = [](const std::string&) { return true; };
  found.load = [=](std::size_t i, int width_px, int height_px) {
    core::Frame frame = renderer->render(T_world_source * recording->pose(i),
                                         recording->intrinsics().resized(width_px, height_px),
                                         core::Channels::kLabels);
    return training::TrueLabels{
        std::move(frame.semantic), std::move(frame.instance), {}, {}, 0};
  };
  return found;
}

std::string list_of(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

/// Every figure that was printed.
core::MeasurementRecord measured(const std::string& title,
                                 const training::MaskQuality& quality,
                                 const std::vector<training::ClassRow>& rows, bool scene,
                                 std::size_t views) {
  core::MeasurementRecord record;
  record.title = title;
  record.values.push_back({"", "views", "", static_cast<double>(views)});
  if (!scene) {
    record.values.push_back({"", "PQ of views, IoU > 0.3", "", 100.0 * quality.views.pq});
    record.values.push_back(
        {"", "PQ of views, IoU > 0.5 (COCO)", "", 100.0 * quality.coco.pq});
  }
  for (const training::ClassRow& row : rows) {
    record.values.push_back({row.name, "PQ", "", 100.0 * row.pq});
    record.values.push_back({row.name, "SQ", "", 100.0 * row.sq});
    record.values.push_back({row.name, "RQ", "", 100.0 * row.rq});
    record.values.push_back({row.name, "found", "", static_cast<double>(row.true_positives)});
    record.values.push_back({row.name, "false", "", static_cast<double>(row.false_positives)});
    record.values.push_back({row.name, "missed", "", static_cast<double>(row.missed)});
  }
  return record;
}

void measure(const MeasureFlags& flags) {
  const bool annotated = reconstruction::is_mask_set(flags.truth.recording);
  const bool bundle = fs::exists(flags.masks / "scene.yaml");
  if (annotated && bundle) {
    throw InputError::expected("--truth", "a recording, whose cameras the bundle is seen from",
                               "annotated views");
  }
  const Truth truth =
      annotated ? truth_of_masks(flags.truth.recording) : truth_of_recording(flags.truth);
  const Found found = bundle ? found_in_bundle(flags.masks, flags.truth, truth)
                             : found_in_masks(flags.masks, truth);
  if (found.translation.common.empty()) {
    throw InputError::expected(flags.masks.string(), "a class of " + truth.name,
                               list_of(found.translation.unknown));
  }
  std::vector<std::size_t> chosen;
  for (std::size_t i = 0; i < truth.views.size();
       i += static_cast<std::size_t>(flags.truth.frame_step)) {
    const bool wanted =
        flags.held_out_every == 0 || i % static_cast<std::size_t>(flags.held_out_every) == 0;
    if (wanted && found.has(truth.views[i])) chosen.push_back(i);
  }
  if (chosen.empty()) {
    throw InputError::expected(
        flags.masks.string(),
        "masks named like the views of " + truth.name +
            (truth.views.empty() ? "" : ", for example " + truth.views.front()),
        found.example.empty() ? "no masks" : found.example);
  }
  reconstruction::ContingencyTable table;
  core::Progress progress("measure masks", static_cast<std::int64_t>(chosen.size()));
  int width_px = 0;
  for (const std::size_t i : chosen) {
    const training::TrueLabels labels = truth.load(i);
    if (width_px == 0) width_px = labels.semantic.width_px();
    if (labels.semantic.width_px() != width_px) {
      throw InputError::expected(truth.views[i],
                                 "views of one width, " + std::to_string(width_px),
                                 std::to_string(labels.semantic.width_px()));
    }
    training::TrueLabels view = found.load(i, width_px, labels.semantic.height_px());
    found.translation.apply(view.semantic, view.instance);
    table.add_frame(labels.images(), view.images());
    progress.update(static_cast<std::int64_t>(table.frame_count()));
  }
  progress.finish();
  const training::MaskQuality quality = training::mask_quality(table, truth.classes, width_px);
  const auto rows = training::class_rows(found.scene ? quality.strict : quality.coco,
                                         truth.classes, found.translation.common);
  std::printf("%s: %s; %zu of %zu views\n\n", flags.masks.string().c_str(),
              found.source.c_str(), table.frame_count(), truth.views.size());
  if (!found.scene) {
    std::printf("%s\n",
                training::mask_quality_text(flags.masks.filename().string(), quality).c_str());
  }
  std::printf("%s", training::class_rows_text(found.scene ? "Scene, strict, IoU > 0.5"
                                                          : "Single views, COCO, IoU > 0.5",
                                              rows)
                        .c_str());
  if (!found.translation.unknown.empty()) {
    std::printf("not in the truth, so not measured: %s\n",
                list_of(found.translation.unknown).c_str());
  }
  support::save_record(flags.record,
                       measured(flags.masks.filename().string() + " against " + truth.name,
                                quality, rows, found.scene, table.frame_count()));
}

void add_truth_flags(CLI::App& command, TruthFlags& flags) {
  command.add_option("--boxes", flags.boxes, "3-D boxes (JSON) that label the recording");
  command.add_option("--label-map", flags.label_map,
                     "Classes of a data set's label images (YAML, docs/datasets.md)");
  command.add_option("--layout", flags.layout, "Layout of the recording (docs/datasets.md)")
      ->capture_default_str();
  command
      .add_option("--floor-height", flags.floor_height_m,
                  "Floor along up, in the recording's frame [m]; default: found")
      ->check(light::coordinate());
  command.add_option("--frame-step", flags.frame_step, "Use every n-th frame")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
}

void add_simulate_command(CLI::App& masks) {
  auto flags = std::make_shared<SimulateFlags>();
  CLI::App* command = masks.add_subcommand(
      "simulate", "Make noisy masks from exact labels, and say how good they are");
  command->add_option("recording", flags->truth.recording, "Recording with exact labels")
      ->required();
  command->add_option("--out", flags->out, "Folder for the masks")->required();
  command
      ->add_option("--level", flags->level,
                   "0: exact masks with random ids; 1: as noisy as published")
      ->check(CLI::Range(0.0, 10.0))
      ->capture_default_str();
  command->add_flag(
      "--fit", flags->fit,
      "First scale the noise until views of this recording give the published RQ and SQ");
  command->add_option("--seed", flags->seed, "Other errors, same rates")
      ->capture_default_str();
  command->add_option("--preview", flags->preview,
                      "Picture (.png) of the middle view: truth above, masks below");
  command->add_flag("--overwrite", flags->overwrite, "Replace a complete set");
  add_truth_flags(*command, flags->truth);
  command->callback([flags] { simulate(*flags); });
}

void add_measure_command(CLI::App& masks) {
  auto flags = std::make_shared<MeasureFlags>();
  CLI::App* command =
      masks.add_subcommand("measure",
                           "Compare a folder of masks, or the labels of a bundle, with exact "
                           "labels: classes of equal name");
  command
      ->add_option(
          "masks", flags->masks,
          "Folder of masks (docs/masks.md), or a bundle, which is then drawn from the "
          "recording's cameras")
      ->required();
  command
      ->add_option("--truth", flags->truth.recording,
                   "Recording with exact labels, or annotated views: masks with masks.yaml")
      ->required();
  add_truth_flags(*command, flags->truth);
  command
      ->add_option(
          "--held-out-every", flags->held_out_every,
          "Only every n-th frame, which `segsim reconstruct` does not train on; 0: all")
      ->check(CLI::Range(0, 1'000'000))
      ->capture_default_str();
  command->add_option("--record", flags->record, support::kRecordHelp);
  command->callback([flags] { measure(*flags); });
}

}  // namespace

void add_masks_command(CLI::App& app) {
  CLI::App* command = light::add_listed(app, light::kCommands, "masks");
  command->require_subcommand(1);
  add_simulate_command(*command);
  add_measure_command(*command);
  add_masks_detect(*command);
  add_masks_make(*command);
}

}  // namespace segsim::experiments::commands::detectors
