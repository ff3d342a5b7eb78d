#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/formatted.h"
#include "experiments/commands/detectors/detector_commands.h"
#include "experiments/commands/light/flag_values.h"
#include "experiments/detection/box_masks.h"
#include "experiments/scenes/scene_source.h"
#include "experiments/support/text_grid.h"
#include "perception/data/image_file.h"

namespace segsim::experiments::commands::detectors {
namespace {

namespace fs = std::filesystem;

struct Flags {
  detection::BoxMaskOptions options;
  fs::path recording, label_map, picture;
  std::string layout = "auto", on_bad_frame = "refuse";
  std::optional<double> floor_height_m;
  bool no_room = false, overwrite = false;
};

std::string report_text(const detection::BoxMaskReport& report) {
  support::internal::TextGrid grid;
  grid.header = {"Class", "Masks", "Of each view"};
  for (std::size_t k = 0; k < report.classes.size(); ++k) {
    if (report.masks[k] == 0) continue;
    const double a_view =
        static_cast<double>(report.masks[k]) / static_cast<double>(report.views);
    grid.rows.push_back({report.classes[k].name, std::to_string(report.masks[k]),
                         core::print("%.2f", a_view)});
  }
  return support::internal::text_of(grid);
}

void run(const Flags& flags) {
  const fs::path& out = flags.options.output;
  if (fs::exists(out / "masks.yaml") && !flags.overwrite) {
    throw core::InputError::expected(out.string(), "a new folder, or --overwrite",
                                     "a complete set of masks");
  }
  const std::string ending = flags.picture.extension().string();
  if (!flags.picture.empty() && ending != ".png" && ending != ".jpg") {
    throw core::InputError::expected("--picture", "a file .png or .jpg",
                                     flags.picture.string());
  }
  reconstruction::SequenceOptions reading;
  reading.layout = reconstruction::parse_sequence_layout(flags.layout, "--layout");
  reading.on_bad_frame =
      reconstruction::parse_on_bad_frame(flags.on_bad_frame, "--on-bad-frame");
  reading.label_map = flags.label_map;
  reading.floor_height_m = flags.floor_height_m;
  const auto recording = scenes::open_recording(flags.recording, {}, reading);
  if (flags.overwrite) {
    // Before anything is removed.
    (void)detection::open_detector(flags.options.detector, flags.options.prompt,
                                   flags.options.score_threshold);
    detection::remove_box_masks(out);
  }
  detection::BoxMaskOptions options = flags.options;
  options.room = !flags.no_room;
  const detection::BoxMaskReport report = detection::make_box_masks(*recording, options);
  std::printf("%s: masks of %zu views", out.string().c_str(), report.views);
  if (report.kept > 0) std::printf(" (%zu were there)", report.kept);
  std::printf("\n\n%s", report_text(report).c_str());
  if (!flags.picture.empty()) {
    perception::write_image(flags.picture,
                            detection::box_mask_sheet(*recording, out, options.frame_step));
    std::printf("\n%s: some of the views\n", flags.picture.string().c_str());
  }
}

}  // namespace

void add_masks_make(CLI::App& masks) {
  auto flags = std::make_shared<Flags>();
  detection::BoxMaskOptions& options = flags->options;
  CLI::App* command = masks.add_subcommand(
      "make",
      "Masks without a segmenter: boxes of a detector cut out by depth and colour; floor, "
      "walls and ceiling by shape. Resumes.");
  command->add_option("recording", flags->recording, "Recording (docs/datasets.md)")
      ->required();
  command
      ->add_option("--detector", options.detector,
                   "Weights of this program, an .onnx or .torchscript YOLO, or a description "
                   "(docs/models.md)")
      ->required();
  command->add_option(
      "--prompt", options.prompt,
      "Classes to look for, \"chair. couch.\"; default: all of the detector's");
  command
      ->add_option("--threshold", options.score_threshold,
                   "Least score of a box; default: the detector's")
      ->check(CLI::Range(0.0, 1.0));
  command->add_option("--out", options.output, "Folder for the masks")->required();
  command->add_option("--picture", flags->picture,
                      "Contact sheet (.png, .jpg) of some views with their masks");
  command->add_flag("--no-room", flags->no_room, "Leave floor, walls and ceiling void");
  command->add_flag("--other", options.other,
                    "Surfaces that are nothing else become class 'other' instead of void: for "
                    "detectors that miss little");
  command
      ->add_option("--room-score", options.scores.room,
                   "How sure floor, walls and ceiling are")
      ->check(CLI::Range(0.01, 1.0))
      ->capture_default_str();
  command->add_option("--other-score", options.scores.other, "How sure class 'other' is")
      ->check(CLI::Range(0.01, 1.0))
      ->capture_default_str();
  command->add_option("--layout", flags->layout, "Layout of the recording")
      ->capture_default_str();
  command
      ->add_option("--on-bad-frame", flags->on_bad_frame,
                   "refuse | skip: what a broken image or pose does")
      ->capture_default_str();
  command
      ->add_option("--floor-height", flags->floor_height_m,
                   "Floor along up, in the recording's frame [m]; default: found")
      ->check(light::coordinate());
  command->add_option("--label-map", flags->label_map,
                      "Classes of a data set's label images (YAML, docs/datasets.md)");
  command->add_option("--frame-step", options.frame_step, "Use every n-th frame")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command->add_flag("--overwrite", flags->overwrite,
                    "Replace masks that are there, of whatever recipe");
  command->callback([flags] { run(*flags); });
}

}  // namespace segsim::experiments::commands::detectors
