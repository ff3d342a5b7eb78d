// segsim detector compare | score
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/commands/detectors/detector_commands.h"
#include "experiments/detection/comparison_files.h"
#include "experiments/detection/photo_dataset.h"
#include "experiments/detection/seen_data.h"
#include "experiments/detection/source_dataset.h"
#include "experiments/episodes/episodes.h"
#include "experiments/support/record_file.h"
#include "perception/checkpoint/weights_file.h"
#include "reconstruction/datasets/box_annotation.h"

namespace segsim::experiments::commands::detectors {
namespace {

namespace fs = std::filesystem;

struct CompareFlags {
  detection::ComparisonOptions options;
  std::vector<std::string> sets;  ///< NAME=FILE
  fs::path out, photos, boxes, train, record;
  std::vector<fs::path> episodes;
  int photo_step = 8;
  detection::SourceDatasetOptions source{.seed = 900'000, .rooms = 0, .views_per_room = 8};
  double floor_height_m = 0.0;
  bool has_floor = false;
  double leak_radius_m = 1.0;
};

struct NamedSet {
  std::string name;
  fs::path json;
};

NamedSet parse_set(const std::string& text) {
  const std::size_t equal = text.find('=');
  const std::string name = text.substr(0, equal);
  const bool plain = name.find_first_not_of(
                         "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_") ==
                     std::string::npos;
  if (equal == std::string::npos || name.empty() || !plain || equal + 1 == text.size()) {
    throw core::InputError::expected(
        "--on", "NAME=FILE.json with a name of letters, digits, - and _", "'" + text + "'");
  }
  return {name, text.substr(equal + 1)};
}

NamedSet photo_set(const CompareFlags& flags) {
  if (flags.boxes.empty()) {
    throw core::InputError::expected("--photo-boxes", "the annotated 3-D boxes of --photos",
                                     "nothing");
  }
  reconstruction::SequenceOptions sequence_options;
  sequence_options.on_bad_frame = reconstruction::OnBadFrame::kSkip;
  if (flags.has_floor) sequence_options.floor_height_m = flags.floor_height_m;
  const auto sequence = reconstruction::open_sequence(flags.photos, sequence_options);
  detection::PhotoOptions options;
  options.class_names = perception::read_weights(flags.options.before).class_names;
  options.frame_step = flags.photo_step;
  return {"photographs", detection::write_photo_dataset(
                             *sequence, reconstruction::read_box_annotation(flags.boxes),
                             options, flags.out / "photographs")};
}

/// Plain rooms that no training saw (their seeds lie far from those of pretraining).
NamedSet source_set(const CompareFlags& flags) {
  return {"source", detection::render_source_dataset(flags.source, flags.out / "source")};
}

/// Says how many training views lie where evaluation episodes start.
std::vector<std::string> leak_notes(const CompareFlags& flags) {
  if (flags.train.empty() || flags.episodes.empty()) {
    return {
        "Not checked: whether 'after' was trained on views near the starts of evaluation "
        "episodes (--train, --episodes)"};
  }
  std::vector<std::string> notes;
  const perception::CocoDataset train = perception::read_coco(flags.train);
  for (const fs::path& file : flags.episodes) {
    const episodes::EpisodeSet set = episodes::read_episodes(file);
    std::vector<glm::dvec2> starts_m;
    for (const sim::Episode& episode : set.episodes) {
      starts_m.emplace_back(episode.start.x_m, episode.start.y_m);
    }
    const auto unplaced =
        std::count_if(train.images.begin(), train.images.end(),
                      [](const auto& image) { return image.scene.empty() || !image.view; });
    char text[240];
    if (unplaced > 0) {
      std::snprintf(
          text, sizeof text,
          "Not known: %td of %zu training views do not say where they were taken, so "
          "they may lie near the starts in %s",
          unplaced, train.images.size(), set.scene.c_str());
    } else {
      std::snprintf(text, sizeof text,
                    "%d of %zu training views lie within %.2f m of a start of the %zu "
                    "evaluation episodes in %s",
                    perception::views_near(train, set.scene, starts_m, flags.leak_radius_m),
                    train.images.size(), flags.leak_radius_m, starts_m.size(),
                    set.scene.c_str());
    }
    notes.emplace_back(text);
  }
  return notes;
}

/// Says of either detector whether it was trained on what a set shows.
std::vector<std::string> seen_notes(const detection::ComparisonOptions& options,
                                    const NamedSet& set) {
  const perception::DataUse tested = perception::data_use(perception::DataPurpose::kValidation,
                                                          perception::read_coco(set.json));
  std::vector<std::string> notes;
  for (const fs::path& weights : {options.before, options.after}) {
    const detection::SeenData seen = detection::seen_data(weights, tested);
    for (const std::string& line : seen.warnings) notes.push_back(set.name + ": " + line);
    for (const std::string& line : seen.unknown) notes.push_back(set.name + ": " + line);
    if (seen.warnings.empty() && seen.unknown.empty()) {
      notes.push_back(set.name + ": " + weights.filename().string() +
                      " was trained neither on these images nor on their scenes");
    }
  }
  return notes;
}

void compare(const CompareFlags& flags) {
  std::vector<NamedSet> sets;
  for (const std::string& text : flags.sets) sets.push_back(parse_set(text));
  if (flags.source.rooms > 0) sets.push_back(source_set(flags));
  if (!flags.photos.empty()) sets.push_back(photo_set(flags));
  if (sets.empty()) {
    throw core::InputError::expected("--on", "NAME=FILE.json, or --photos, or --source-rooms",
                                     "nothing");
  }
  detection::ComparisonReport report;
  report.options = flags.options;
  report.notes = leak_notes(flags);
  for (const NamedSet& set : sets) {
    for (std::string& note : seen_notes(flags.options, set)) {
      report.notes.push_back(std::move(note));
    }
    report.sets.push_back(detection::compare_on_set(flags.options, set.name, set.json));
  }
  detection::write_comparison(flags.out, report);
  support::save_record(flags.record, detection::comparison_record(report));
  std::printf("%s\nwritten to %s\n", detection::comparison_text(report).c_str(),
              flags.out.string().c_str());
}

struct ScoreFlags {
  fs::path truth, results, record;
  bool reference_ignore = false;
};

void score(const ScoreFlags& flags) {
  const perception::CocoFiles files = perception::read_coco_results(
      flags.truth, flags.results, {.honour_ignore = !flags.reference_ignore});
  const perception::CocoSummary s =
      perception::coco_summary(files.images, static_cast<int>(files.class_names.size()));
  const std::pair<const char*, double> lines[] = {{"AP", s.ap},
                                                  {"AP50", s.ap50},
                                                  {"AP75", s.ap75},
                                                  {"AP_small", s.ap_small},
                                                  {"AP_medium", s.ap_medium},
                                                  {"AP_large", s.ap_large},
                                                  {"AR_1", s.ar_1},
                                                  {"AR_10", s.ar_10},
                                                  {"AR_100", s.ar_100},
                                                  {"AR_small", s.ar_small},
                                                  {"AR_medium", s.ar_medium},
                                                  {"AR_large", s.ar_large}};
  core::MeasurementRecord record{"COCO's twelve numbers", false, {}};
  for (const auto& [name, value] : lines) {
    std::printf("%-10s %.9f\n", name, value);
    // COCO says -1 where the truth has no object of that size.
    if (value >= 0.0) {
      record.values.push_back({flags.results.stem().string(), name, "%", 100.0 * value});
    }
  }
  if (record.values.empty() && !flags.record.empty()) {
    throw core::InputError::expected(flags.truth.string(), "an object to find, for --record",
                                     "none");
  }
  support::save_record(flags.record, record);
}

}  // namespace

void add_detector_compare(CLI::App& detector) {
  auto flags = std::make_shared<CompareFlags>();
  CLI::App* command = detector.add_subcommand(
      "compare", "'Before' and 'after' weights on several sets: tables, curves, worst misses");
  command->add_option("--before", flags->options.before, "Weights")->required();
  command->add_option("--after", flags->options.after, "Weights")->required();
  command->add_option("--out", flags->out, "Folder for the report")->required();
  command->add_option("--on", flags->sets,
                      "NAME=FILE.json, for example views=val_views.json; may be repeated");
  command->add_option("--photos", flags->photos, "Recording of real frames to evaluate on");
  command->add_option("--photo-boxes", flags->boxes, "Its annotated 3-D boxes, JSON");
  command->add_option("--photo-step", flags->photo_step, "Every so many frames")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  CLI::Option* floor = command->add_option(
      "--photo-floor-m", flags->floor_height_m,
      "Height of the floor along the recording's up axis [m]; default: fitted");
  command
      ->add_option("--source-rooms", flags->source.rooms,
                   "Plain rooms to render as the source domain: what tuning forgets")
      ->check(CLI::Range(0, 100000));
  command->add_option("--distances", flags->options.distances_m, "Borders of ranges [m]")
      ->delimiter(',')
      ->check(CLI::PositiveNumber);
  command->add_option("--rounds", flags->options.rounds, "Bootstrap draws")
      ->check(CLI::Range(0, 1'000'000))
      ->capture_default_str();
  command->add_option("--seed", flags->options.seed, "Of the bootstrap")
      ->capture_default_str();
  command->add_option("--train", flags->train,
                      "COCO JSON that 'after' was trained on, for the leak check");
  command->add_option("--episodes", flags->episodes, "Episode files of the evaluation");
  command->add_option("--leak-radius-m", flags->leak_radius_m, "Of the leak check [m]")
      ->capture_default_str();
  command->add_option("--record", flags->record, support::kRecordHelp);
  command->callback([flags, floor] {
    flags->has_floor = floor->count() > 0;
    std::sort(flags->options.distances_m.begin(), flags->options.distances_m.end());
    compare(*flags);
  });

  auto score_flags = std::make_shared<ScoreFlags>();
  CLI::App* score_command = detector.add_subcommand(
      "score", "COCO's twelve numbers of a results file, from any detector");
  score_command->add_option("--truth", score_flags->truth, "COCO instances JSON")->required();
  score_command->add_option("--results", score_flags->results, "COCO results JSON")
      ->required();
  score_command->add_flag("--reference-ignore", score_flags->reference_ignore,
                          "Only iscrowd is ignored, as the reference does");
  score_command->add_option("--record", score_flags->record, support::kRecordHelp);
  score_command->callback([score_flags] { score(*score_flags); });
}

}  // namespace segsim::experiments::commands::detectors
