#pragma once

/// @file
/// Every subcommand of `segsim`, and which of two programs does it.
///
/// `segsim-main` does all of them. Its libraries (libtorch, OpenCV's codecs, VTK, Gazebo's
/// transport) take half a second and 200 MB to load, so `segsim-light` does those that read
/// results and files alone. The launcher chooses by the words of the command line.

#include <algorithm>
#include <cstddef>
#include <span>
#include <string_view>

namespace segsim::experiments::commands::light {

struct CommandWord {
  const char* name;
  const char* help;  ///< One line.
  bool light;        ///< segsim-light can do it, but for what its own subcommands say.
};

/// In the order of `segsim --help`.
inline constexpr CommandWord kCommands[] = {
    {"run", "Run an experiment: prepare, run all trials, print the table. Resumes.", false},
    {"merge", "Put the shards of a run together (docs/scale_out.md)", false},
    {"table",
     "Print the table of a run, or one of the paper's: text, Markdown, LaTeX, CSV, JSON",
     true},
    {"suite", "Suites of scenes and episodes that others run, too: list, show, run, verify",
     true},
    {"capture", "Record a mesh world with a virtual RGB-D camera: colour, depth, exact labels",
     false},
    {"reconstruct", "Make a scene bundle from posed RGB-D frames: lift, then train", false},
    {"scene", "Look at scene bundles, mend them, correct their labels", false},
    {"render", "Render one view of a bundle or a 2DGS .ply: every channel to EXR, or a sheet",
     false},
    {"label",
     "Render 3-D-consistent boxes from bundles, where the robot can be, to COCO and YOLO",
     false},
    {"detector", "Train and evaluate the object detector", false},
    {"masks", "Masks of single views, as a 2-D segmenter makes them", false},
    {"evaluate", "Compare label images of any program with the truth: PQ, SQ, RQ, mIoU",
     false},
    {"gazebo", "Be a running Gazebo's camera; export a world for it", false},
    {"bench", "Measure the renderer on this machine", false},
    {"budget", "Latency budgets: check them, sweep a delay, record a trace", false},
    {"replay", "Run recorded trials again and name the first tick and field that differ",
     false},
    {"episodes", "Search tasks: generate, validate, import from and export to Habitat", false},
    {"explain", "Tell the story of a trial and why it failed; without TRIAL list failures",
     false},
    {"compare", "Two arms of a run: difference, paired tests, the episodes that changed",
     true},
    {"doctor",
     "Say what this machine computes with; compare a run's digests with recorded ones", false},
    {"plan", "How many episodes a comparison of two arms needs", true},
    {"export", "Write the trials of a run as CSV or JSON Lines", true},
    {"report", "Write a run as HTML pages: the answer, plots, maps, every trial", false},
    {"serve", "Show runs in a browser: progress, what the robots see now, finished trials",
     false},
    {"sensors", "Draw one view of a scene as each sensor model delivers it", false},
    {"robots", "List the robots that `robot:` may name, or check files of robots", true},
    {"trial", "Scripted trials: where to drive, what goes wrong, what must hold", true},
    {"video", "Write a trial as a video, a pair of trials, or a demo of the run", false},
    {"record", "Write a trial as ROS 2 messages into an MCAP file (docs/ros2.md)", false},
    {"ros", "Be a robot on a ROS 2 network: images out, commands in (docs/ros2.md)", false},
};

inline constexpr CommandWord kTableCommands[] = {
    {"1", "Fill the paper's Table 1: train and test label heads in scenes, beside its figures",
     false},
    {"2", "Measure the paper's Table 2: tile intersection and Top-K, beside its figures",
     false},
    {"3", "The paper's Table 3: success before and after fine-tuning, with intervals and p",
     true},
    {"all", "Every table of the paper into one folder (Table 1 trains: hours without --quick)",
     false},
};

inline constexpr CommandWord kTrialCommands[] = {
    {"check", "Read a file and check it against its scene, without driving", true},
    {"run", "Drive it. Exit code 1 if a step was not done or an expectation does not hold",
     false},
};

inline constexpr CommandWord kSuiteCommands[] = {
    {"list", "The suites that come with the program", true},
    {"show", "Scenes, arms and hash of a suite; with --spec the spec that it stands for",
     true},
    {"run", "Prepare and run it as `segsim run` does, then write page, episodes and manifest",
     false},
    {"table", "Print the table of a suite's run, and write page, episodes and manifest",
     false},
    {"verify", "Compare the hashes of two runs, or of one with the suite that is here", true},
};

/// The entry of this name; null if there is none.
constexpr const CommandWord* find_command(std::span<const CommandWord> list,
                                          std::string_view name) {
  const auto found = std::find_if(list.begin(), list.end(),
                                  [&](const CommandWord& word) { return word.name == name; });
  return found == list.end() ? nullptr : &*found;
}

/// Whether segsim-light can do what a command line asks for. `segsim --help`, `segsim
/// --version` and mistakes are its business, too. The answer may be no for a light command
/// whose option has the value "run" or "2": segsim-main does it as well.
/// @param words  Without the program's name.
constexpr bool is_light(std::span<const char* const> words) {
  // Before its command, `segsim` has no option that takes a value.
  const auto command = std::find_if(words.begin(), words.end(), [](const char* word) {
    return !std::string_view(word).starts_with('-');
  });
  if (command == words.end()) return true;
  const CommandWord* entry = find_command(kCommands, *command);
  if (entry == nullptr) return true;
  if (!entry->light) return false;
  const auto names_heavy = [&](std::span<const CommandWord> list) {
    return std::any_of(command + 1, words.end(), [&](const char* word) {
      const CommandWord* below = find_command(list, word);
      return below != nullptr && !below->light;
    });
  };
  const std::string_view name = entry->name;
  return !(name == "table" && names_heavy(kTableCommands)) &&
         !(name == "suite" && names_heavy(kSuiteCommands)) &&
         !(name == "trial" && names_heavy(kTrialCommands));
}

}  // namespace segsim::experiments::commands::light
