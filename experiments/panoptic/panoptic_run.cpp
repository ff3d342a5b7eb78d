#include "experiments/panoptic/panoptic_run.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>
#include <sstream>
#include <utility>

#include "core/error.h"
#include "core/file_io.h"
#include "core/progress.h"
#include "core/version.h"
#include "experiments/scenes/reconstruct.h"
#include "experiments/scenes/scene_source.h"
#include "experiments/support/step_record.h"
#include "experiments/training/mask_quality.h"
#include "experiments/training/training_run.h"
#include "reconstruction/datasets/label_map.h"
#include "reconstruction/datasets/mask_files.h"
#include "renderer/cpu_renderer.h"
#include "renderer/files/ply_io.h"

namespace segsim::experiments::panoptic {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using Recording = reconstruction::RgbdSequence;

/// Label iterations that take as long as one of shape and colour (docs/training.md).
constexpr double kLabelCost = 0.05;

/// Says what comes next and how long the rest will take, from what was done in this run.
class Outlook {
 public:
  explicit Outlook(double total) : total_(total) {}

  void announce(const std::string& what, int number, int of) const {
    std::string left;
    if (done_ > 0.0) {
      const double seconds = std::chrono::duration<double>(Clock::now() - start_).count() *
                             (total_ / done_ - 1.0);
      left = "; about " + core::format_duration(seconds) + " left in all";
    }
    std::fprintf(stderr, "[%d/%d] %s%s\n", number, of, what.c_str(), left.c_str());
  }
  void add(double cost) { done_ += cost; }

 private:
  double total_, done_ = 0.0;
  Clock::time_point start_ = Clock::now();
};

std::string describe_masks(const PanopticRunOptions& options, const PanopticScene& scene) {
  if (!scene.masks.empty()) return "masks of " + scene.masks.filename().string();
  if (!options.mask_level) return "exact labels";
  training::MaskSimulation simulation;
  simulation.level = *options.mask_level;
  simulation.fit = options.fit_masks;
  simulation.seed = options.seed;
  return training::describe(simulation);
}

/// @param head  Of PanopticRunOptions::heads.
void set_head(training::TrainingOptions& training, const std::string& head) {
  const std::string suffix = kJointSuffix;
  training.joint = head.ends_with(suffix);
  training.head = training.joint ? head.substr(0, head.size() - suffix.size()) : head;
}

/// What frames are used and how; shape and colour follow from it and the configuration.
std::string describe_frames(const PanopticRunOptions& options, const PanopticScene& scene) {
  std::ostringstream text;
  text << scenes::describe_capture(scene.source) << "; voxel " << scene.source.voxel_m
       << " m, shrink " << scene.shrink << ", every " << options.held_out_every
       << ". frame held out";
  if (!scene.label_map.empty()) text << ", labels " << scene.label_map.filename().string();
  return text.str();
}

/// One scene: what its heads share is made when it is first needed.
class SceneJob {
 public:
  SceneJob(const PanopticRunOptions& options, const PanopticScene& scene)
      : options_(options), scene_(scene), folder_(options.work / scene.name) {}

  [[nodiscard]] std::optional<SceneFigures> finished(const std::string& head) const {
    const fs::path file = result_file(head);
    if (!fs::exists(file)) return std::nullopt;
    SceneFigures figures = read_scene_figures(file);
    if (figures.recipe != recipe(head)) return std::nullopt;
    return figures;
  }
  [[nodiscard]] bool has_surfels() const { return surfel_record().is_current(); }

  /// Makes recording, masks and surfels.
  void prepare();
  SceneFigures run(const std::string& head);
  /// Frees the frames.
  void close() {
    set_.reset();
    recording_.reset();
  }

 private:
  [[nodiscard]] fs::path result_file(const std::string& head) const {
    return folder_ / (head + ".json");
  }
  [[nodiscard]] fs::path surfel_file() const { return folder_ / "surfels.ply"; }
  [[nodiscard]] std::string surfel_recipe() const {
    reconstruction::TrainingConfig config = options_.config;
    config.panoptic = {};  // These take no part.
    config.joint = {};
    return describe_frames(options_, scene_) + "; seed " + std::to_string(options_.seed) +
           ", geometry " + core::sha256_hex(reconstruction::training_config_text(config));
  }
  [[nodiscard]] support::StepRecord surfel_record() const {
    return {folder_ / "surfels.step", surfel_recipe()};
  }
  [[nodiscard]] std::string recipe(const std::string& head) const {
    return surfel_recipe() + "; " + head + ", " + describe_masks(options_, scene_) +
           ", labels " +
           core::sha256_hex(reconstruction::training_config_text(options_.config));
  }
  [[nodiscard]] bool simulates() const {
    return scene_.masks.empty() && options_.mask_level.has_value();
  }
  /// Options of a stage; its state is that of its recipe alone.
  [[nodiscard]] training::TrainingOptions stage(const std::string& name,
                                                const std::string& stage_recipe) const;

  void open();
  void prepare_masks();
  void prepare_surfels();
  [[nodiscard]] core::FrameMasks truth_of(const reconstruction::TrainingView& view) const;
  [[nodiscard]] std::vector<core::SceneClass> evaluated_classes() const;

  const PanopticRunOptions& options_;
  const PanopticScene& scene_;
  fs::path folder_;
  std::unique_ptr<Recording> recording_;
  std::optional<reconstruction::TrainingSet> set_;
};

training::TrainingOptions SceneJob::stage(const std::string& name,
                                          const std::string& stage_recipe) const {
  training::TrainingOptions training;
  training.config = options_.config;
  training.device = options_.device;
  training.seed = options_.seed;
  training.set.held_out_every = options_.held_out_every;
  training.set.frame_step = scene_.source.frame_step;
  training.set.shrink = scene_.shrink;
  training.resume = true;
  training.work =
      folder_ / (name + "-" + core::sha256_hex(stage_recipe).substr(0, 8) + ".training");
  if (simulates()) {
    training.masks = folder_ / "masks";
  } else {
    training.masks = scene_.masks;
  }
  return training;
}

void SceneJob::open() {
  fs::path place = scene_.source.folder;
  if (scene_.source.type != specs::SourceType::kRgbd) {
    // A capture goes on where it was stopped; one of another recipe has another folder.
    const std::string recipe = scenes::describe_capture(scene_.source);
    place = folder_ / ("recording-" + core::sha256_hex(recipe).substr(0, 8));
    scenes::capture_mesh_source(scene_.source, place);
  }
  reconstruction::SequenceOptions sequence;
  sequence.on_bad_frame = reconstruction::OnBadFrame::kSkip;
  sequence.label_map = scene_.label_map;
  if (scene_.source.type == specs::SourceType::kRgbd) {
    sequence.floor_height_m = scene_.source.floor_height_m;
  }
  recording_ = scenes::open_recording(place, scene_.source.boxes, sequence);
  for (const std::string& warning : recording_->warnings()) {
    std::fprintf(stderr, "warning: %s\n", warning.c_str());
  }
  if (!recording_->has_masks()) {
    throw core::InputError::expected(
        place.string(), "labels to compare with (a labelled data set, or `label_map`)",
        "none");
  }
  if (!recording_->has_depth()) {
    throw core::InputError::expected(place.string(), "frames with depth", "colour alone");
  }
}

void SceneJob::prepare_masks() {
  if (!simulates()) return;
  const fs::path masks = folder_ / "masks";
  const support::StepRecord record(
      folder_ / "masks.step",
      describe_frames(options_, scene_) + "; " + describe_masks(options_, scene_));
  if (record.is_current() && fs::exists(masks / "masks.yaml")) return;
  training::MaskSimulation simulation;
  simulation.level = *options_.mask_level;
  simulation.fit = options_.fit_masks;
  simulation.seed = options_.seed;
  simulation.frame_step = scene_.source.frame_step;
  training::simulate_masks(*recording_, simulation, masks);
  record.mark_done();
}

void SceneJob::prepare_surfels() {
  if (has_surfels() && fs::exists(surfel_file())) return;
  training::TrainingOptions training = stage("geometry", surfel_recipe());
  training.head = "none";
  // Surfels know nothing of labels: a state must not be refused because of them.
  training.config.panoptic = {};
  training.config.joint = {};
  training.masks.clear();
  reconstruction::LiftOptions lift;
  lift.voxel_m = scene_.source.voxel_m;
  lift.frame_step = scene_.source.frame_step;
  lift.held_out_every = options_.held_out_every;
  lift.threads = options_.device.threads;
  const reconstruction::LiftResult lifted = scenes::lift_recording(*recording_, lift);
  const training::TrainedScene trained =
      training::train_scene(*set_, lifted.surfels, training);
  std::fprintf(stderr, "%s: %s\n", scene_.title.c_str(), trained.quality.text().c_str());
  core::write_via_temporary(surfel_file(), [&](const fs::path& file) {
    renderer::write_surfels_ply(file, trained.surfels);
  });
  surfel_record().mark_done();
  training::remove_training_state(training.work);
}

void SceneJob::prepare() {
  if (set_) return;
  fs::create_directories(folder_);
  open();
  prepare_masks();
  set_ = training::load_set(*recording_, stage("geometry", surfel_recipe()));
  if (set_->held_out.empty()) {
    throw core::InputError::expected(
        scene_.title, "held-out views",
        std::to_string(set_->training.size()) + " frames, none held out");
  }
  prepare_surfels();
}

/// The recording's labels of a training view; it carries those that were learnt from.
core::FrameMasks SceneJob::truth_of(const reconstruction::TrainingView& view) const {
  if (!simulates() && scene_.masks.empty()) return view.masks;
  reconstruction::TrainingView exact;
  const reconstruction::RgbdFrame frame = recording_->load(view.frame);
  exact.rgb = frame.rgb;
  exact.masks = reconstruction::exact_masks(frame);
  return scene_.shrink > 1 ? reconstruction::shrunk(exact, scene_.shrink).masks : exact.masks;
}

std::vector<core::SceneClass> SceneJob::evaluated_classes() const {
  if (scene_.label_map.empty()) return recording_->classes();
  return reconstruction::read_label_map(scene_.label_map).evaluated();
}

SceneFigures SceneJob::run(const std::string& head) {
  training::TrainingOptions training = stage(head, recipe(head));
  set_head(training, head);
  training.config.geometry.iterations = 0;  // The surfels are there, the same for all heads.
  const renderer::SurfelCloud surfels = renderer::read_surfels_ply(surfel_file());
  training.config.geometry.sh_degree = surfels.sh_degree;
  training::TrainedScene trained = training::train_scene(*set_, surfels, training);

  renderer::RenderOptions draw;
  draw.threads = options_.device.threads;
  const auto renderer = renderer::make_cpu_renderer(
      std::make_shared<const renderer::SurfelCloud>(std::move(trained.surfels)), draw,
      trained.field);
  const reconstruction::ContingencyTable trajectory = reconstruction::trajectory_labels(
      *renderer, *set_,
      [&](const reconstruction::TrainingView& view) { return truth_of(view); });

  SceneFigures figures;
  figures.scene = scene_.name;
  figures.title = scene_.title;
  figures.data = scene_.data;
  figures.head = head;
  figures.masks = describe_masks(options_, scene_);
  figures.recipe = recipe(head);
  figures.version = core::version();
  figures.rules = all_rule_figures(trained.quality.labels, trajectory, evaluated_classes(),
                                   scene_.zju_min_iou());
  figures.statistics = trained.statistics;
  figures.statistics.emplace_back("surfels", static_cast<double>(surfels.size()));
  if (simulates()) {
    figures.mask_quality =
        reconstruction::read_mask_set_info(folder_ / "masks" / "masks.yaml").measured;
  }
  write_scene_figures(result_file(head), figures);
  training::remove_training_state(training.work);
  return figures;
}

}  // namespace

std::vector<SceneFigures> run_panoptic_scenes(const PanopticRunOptions& options) {
  for (const std::string& head : options.heads) {  // Before the long work.
    training::TrainingOptions training;
    training.config = options.config;
    training.device = options.device;
    set_head(training, head);
    training::check_joint(training);
  }
  const std::size_t pairs = options.scenes.size() * options.heads.size();
  std::vector<std::optional<SceneFigures>> results(pairs);
  const auto result_of = [&](std::size_t scene, std::size_t head) -> auto& {
    return results[head * options.scenes.size() + scene];
  };
  const auto all_finished = [&] {
    std::vector<SceneFigures> finished;
    for (const auto& result : results) {
      if (result) finished.push_back(*result);
    }
    return finished;
  };
  const double head_cost =
      kLabelCost * static_cast<double>(options.config.panoptic.iterations) + 1.0;
  const double scene_cost = static_cast<double>(options.config.geometry.iterations) + 1.0;

  // What is finished stays; the rest is the work to come.
  double total = 0.0;
  std::vector<SceneJob> jobs;
  for (const PanopticScene& scene : options.scenes) jobs.emplace_back(options, scene);
  for (std::size_t s = 0; s < jobs.size(); ++s) {
    bool complete = true;
    for (std::size_t h = 0; h < options.heads.size(); ++h) {
      result_of(s, h) = jobs[s].finished(options.heads[h]);
      if (!result_of(s, h)) complete = false, total += head_cost;
    }
    if (!complete && !jobs[s].has_surfels()) total += scene_cost;
  }
  Outlook outlook(total);
  for (std::size_t s = 0; s < jobs.size(); ++s) {
    const bool had_surfels = jobs[s].has_surfels();
    for (std::size_t h = 0; h < options.heads.size(); ++h) {
      if (result_of(s, h)) continue;
      outlook.announce(options.scenes[s].title + ", " + options.heads[h],
                       static_cast<int>(all_finished().size()) + 1, static_cast<int>(pairs));
      jobs[s].prepare();
      result_of(s, h) = jobs[s].run(options.heads[h]);
      outlook.add(head_cost);
      if (h == 0 && !had_surfels) outlook.add(scene_cost);
      if (options.on_result) options.on_result(all_finished());
    }
    jobs[s].close();
  }
  return all_finished();
}

void make_quick(PanopticRunOptions& options) {
  constexpr int kWidth_px = 96, kHeight_px = 72, kFrames = 32;
  for (PanopticScene& scene : options.scenes) {
    specs::CaptureSpec& capture = scene.source.capture;
    capture.frames = std::min(capture.frames, kFrames);
    capture.width_px = kWidth_px, capture.height_px = kHeight_px;
    scene.source.voxel_m = std::max(scene.source.voxel_m, 0.08);
    if (scene.source.type == specs::SourceType::kRgbd) {
      scene.source.frame_step *= 7;  // Nothing in common with held_out_every.
      scene.shrink = std::max(scene.shrink, 4);
    }
  }
  options.config.geometry.iterations =
      std::min<std::int64_t>(options.config.geometry.iterations, 60);
  options.config.panoptic.iterations =
      std::min<std::int64_t>(options.config.panoptic.iterations, 100);
  options.config.panoptic.sampling.pixels = 1024;
  options.held_out_every = std::min(options.held_out_every, 4);
  options.fit_masks = false;
}

}  // namespace segsim::experiments::panoptic
