#pragma once

/// @file
/// What the pages of a report are made of.

#include <optional>
#include <string>
#include <vector>

#include <glm/vec2.hpp>

#include "experiments/reproducibility/stage_digests.h"
#include "experiments/results/stored_run.h"
#include "experiments/results/table.h"

namespace segsim::experiments::report::internal {

/// One trial. Files are relative to the report's folder, empty if there is none.
struct TrialView {
  const records::TrialRow* row = nullptr;
  std::string arm, scene;  ///< As the table names them: of all trainings and reconstructions.
  std::string page;        ///< "episodes/flat-3-chair-00.html"
  std::string anchor;      ///< Of the trial on its page.
  /// "gained", "lost", "both", "neither": its episode, before against after; empty: no pair.
  std::string change;
  std::vector<std::string> story;
  std::string picture, strip, video;
  std::vector<glm::dvec2> path_px;  ///< On the scene's map, thinned out.
};

/// The floor of a scene, seen from above.
struct SceneMap {
  std::string scene, title, image;
  int width_px = 0, height_px = 0;
};

struct ReportModel {
  const results::StoredRun* stored = nullptr;
  results::ResultTable table;
  std::vector<TrialView> trials;  ///< In the order of the stored ones.
  std::vector<SceneMap> maps;
  std::optional<reproducibility::DigestRecord> digests;  ///< Of the finished run.
  bool with_plots = false;
  std::vector<std::string> notes;  ///< What is missing and why.
};

/// Arms as the table names them, in its order.
[[nodiscard]] std::vector<std::string> arms_of(const ReportModel& model);
/// Success-blind colour of an arm, or of a training of it, by its place in the run
/// ("#rrggbb").
[[nodiscard]] std::string arm_color(const ReportModel& model, const std::string& arm);
/// What decided the trial: "success", its cause, or its outcome if the cause is not known.
[[nodiscard]] std::string fate_of(const records::TrialRow& trial);
/// For people: "time ran out on the way to a true goal".
[[nodiscard]] std::string fate_in_words(const std::string& fate);

// report_pictures.cpp
/// Fills in maps, paths, stories and pictures, and writes the files.
/// @return  How many pictures were written.
int add_pictures(ReportModel& model, const std::filesystem::path& output, bool draw,
                 int threads);

// report_data.cpp: each a figure with its numbers as a table; empty if there is no data.
[[nodiscard]] std::string success_figure(const ReportModel& model);
[[nodiscard]] std::string causes_figure(const ReportModel& model);
[[nodiscard]] std::string steps_figure(const ReportModel& model);
[[nodiscard]] std::string delay_figures(const ReportModel& model);
[[nodiscard]] std::string latency_figures(const ReportModel& model);

// report_index.cpp
[[nodiscard]] std::string index_body(const ReportModel& model);

// report_episodes.cpp
[[nodiscard]] std::string trials_body(const ReportModel& model);
/// @param trials  Of one episode, never empty.
[[nodiscard]] std::string episode_body(const ReportModel& model,
                                       const std::vector<const TrialView*>& trials);

}  // namespace segsim::experiments::report::internal
