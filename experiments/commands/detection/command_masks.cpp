#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/progress.h"
#include "experiments/commands/commands.h"
#include "experiments/drawing/frame_picture.h"
#include "experiments/scenes/scene_source.h"
#include "experiments/support/text_grid.h"
#include "experiments/training/mask_quality.h"
#include "perception/data/image_file.h"
#include "reconstruction/datasets/mask_files.h"

namespace segsim::experiments::commands {
namespace {

namespace fs = std::filesystem;
using core::InputError;

struct TruthFlags {
  fs::path recording, boxes, label_map;
  std::string layout = "auto";
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
  fs::path masks;
};

std::unique_ptr<reconstruction::RgbdSequence> open_truth(const TruthFlags& flags) {
  reconstruction::SequenceOptions options;
  options.layout = reconstruction::parse_sequence_layout(flags.layout, "--layout");
  options.label_map = flags.label_map;
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

void measure(const MeasureFlags& flags) {
  const Truth truth = reconstruction::is_mask_set(flags.truth.recording)
                          ? truth_of_masks(flags.truth.recording)
                          : truth_of_recording(flags.truth);
  const auto masks = reconstruction::open_masks(flags.masks, truth.classes);
  reconstruction::ContingencyTable table;
  core::Progress progress("measure masks", static_cast<std::int64_t>(masks->names().size()));
  int width_px = 0;
  for (std::size_t i = 0; i < truth.views.size();
       i += static_cast<std::size_t>(flags.truth.frame_step)) {
    const std::string& name = truth.views[i];
    if (!std::binary_search(masks->names().begin(), masks->names().end(), name)) continue;
    const training::TrueLabels labels = truth.load(i);
    if (width_px == 0) width_px = labels.semantic.width_px();
    if (labels.semantic.width_px() != width_px) {
      throw InputError::expected(name, "views of one width, " + std::to_string(width_px),
                                 std::to_string(labels.semantic.width_px()));
    }
    const core::FrameMasks found = masks->read(name, width_px, labels.semantic.height_px());
    table.add_frame(labels.images(), {found.semantic, found.instance});
    progress.update(static_cast<std::int64_t>(table.frame_count()));
  }
  progress.finish();
  if (table.frame_count() == 0) {
    throw InputError::expected(
        flags.masks.string(),
        "masks named like the views of " + truth.name +
            (truth.views.empty() ? "" : ", for example " + truth.views.front()),
        masks->names().empty() ? "no masks" : masks->names().front());
  }
  std::printf(
      "%s: %s; %zu of %zu views\n\n%s", flags.masks.string().c_str(),
      masks->info().source.c_str(), table.frame_count(), truth.views.size(),
      training::mask_quality_text(flags.masks.filename().string(),
                                  training::mask_quality(table, truth.classes, width_px))
          .c_str());
}

void add_truth_flags(CLI::App& command, TruthFlags& flags) {
  command.add_option("--boxes", flags.boxes, "3-D boxes (JSON) that label the recording");
  command.add_option("--label-map", flags.label_map,
                     "Classes of a data set's label images (YAML, docs/datasets.md)");
  command.add_option("--layout", flags.layout, "Layout of the recording (docs/datasets.md)")
      ->capture_default_str();
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
      masks.add_subcommand("measure", "Compare a folder of masks with exact labels");
  command->add_option("masks", flags->masks, "Folder of masks, see docs/masks.md")->required();
  command
      ->add_option("--truth", flags->truth.recording,
                   "Recording with exact labels, or annotated views: masks with masks.yaml")
      ->required();
  add_truth_flags(*command, flags->truth);
  command->callback([flags] { measure(*flags); });
}

}  // namespace

void add_masks_command(CLI::App& app) {
  CLI::App* command = add_listed(app, kCommands, "masks");
  command->require_subcommand(1);
  add_simulate_command(*command);
  add_measure_command(*command);
  add_masks_detect(*command);
  add_masks_make(*command);
}

}  // namespace segsim::experiments::commands
