#include "experiments/training/training_run.h"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <memory>
#include <numbers>
#include <span>
#include <utility>

#include "core/error.h"
#include "core/file_io.h"
#include "core/progress.h"
#include "experiments/support/stop_signal.h"
#include "experiments/training/training_folder.h"
#include "experiments/training/training_preview.h"
#include "reconstruction/datasets/mask_files.h"
#include "reconstruction/labels/panoptic_training.h"
#include "reconstruction/training/joint_training.h"
#include "reconstruction/training/pose_alignment.h"
#include "reconstruction/training/surfel_labels.h"
#include "reconstruction/training/training_memory.h"
#include "reconstruction/training/training_views.h"
#include "renderer/cpu_renderer.h"

namespace segsim::experiments::training {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using reconstruction::TrainingSet;
using renderer::SurfelCloud;

constexpr const char* kGeometryState = "geometry.state";
constexpr const char* kHeadState = "head.state";
constexpr const char* kJointState = "joint.state";
constexpr const char* kHeadMark = "head.iteration";
constexpr double kGeometryShare = 0.6;  ///< Of a time limit.

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// True once every so many seconds.
class Every {
 public:
  explicit Every(double interval_s) : interval_s_(interval_s) {}
  bool due() {
    if (interval_s_ <= 0.0 || seconds_since(last_) < interval_s_) return false;
    last_ = Clock::now();
    return true;
  }
  /// What was due took until now: it may take this share of the time.
  void done() {
    constexpr double kMostShare = 0.05;
    interval_s_ = std::max(interval_s_, seconds_since(last_) / kMostShare);
  }

 private:
  double interval_s_;
  Clock::time_point last_ = Clock::now();
};

/// Lines of losses.csv.
class LossTable {
 public:
  LossTable(const fs::path& file, bool append)
      : file_(file), out_(file, append ? std::ios::app : std::ios::trunc) {
    if (!append) out_ << "stage,iteration,seconds,surfels,loss,value\n" << std::flush;
    check();
  }
  void add(const char* stage, std::int64_t iteration, double seconds, std::int64_t surfels,
           const std::string& loss, double value) {
    out_ << stage << ',' << iteration << ',' << seconds << ',' << surfels << ',' << loss << ','
         << value << '\n'
         << std::flush;
    check();
  }

 private:
  void check() const {
    if (out_) return;
    throw core::InputError::expected(file_.string(), "room to write", std::strerror(errno));
  }

  fs::path file_;
  std::ofstream out_;
};

/// The two stages and what they have in common.
class TrainingRun {
 public:
  TrainingRun(const TrainingSet& set, const SurfelCloud& start, const TrainingOptions& options)
      : set_(set),
        start_(start),
        options_(options),
        identity_(training_identity(options, set, start)),
        preview_due_(options.preview_every_s),
        checkpoint_due_(options.checkpoint_every_s) {
    check_joint(options);
    fs::create_directories(options.work);
    if (!options.resume) {
      remove_training_state(options.work);
    }
    losses_ = std::make_unique<LossTable>(options.work / kLosses,
                                          options.resume && fs::exists(geometry_state()));
  }

  TrainedScene run() {
    if (options_.checkpoint_every_s > 0.0) {
      std::fprintf(stderr,
                   "to look at the scene so far, at any time after %.0f s: "
                   "segsim render %s --view 0 --out view.png\n",
                   options_.checkpoint_every_s, options_.work.string().c_str());
    }
    TrainedScene scene;
    reconstruction::with_memory_errors(
        "training shape and colour", [&] { return geometry_advice(); },
        [&] { scene.surfels = train_geometry(); });
    scene.classes = set_.classes;
    std::shared_ptr<const renderer::PanopticField> field;
    if (options_.head != "none" && !set_.classes.empty()) {
      reconstruction::with_memory_errors(
          "training labels", [&] { return head_advice(); },
          [&] { field = train_head(scene); });
    } else if (start_.has_labels() && start_.size() == scene.surfels.size()) {
      scene.surfels.semantic_id = start_.semantic_id;
      scene.surfels.instance_id = start_.instance_id;
    }
    scene.field = field;
    write_so_far(options_.work, scene.surfels, set_, poses_);
    const auto surfels = std::make_shared<const SurfelCloud>(scene.surfels);
    write_preview(options_.work / "preview.png", set_, surfels, field,
                  options_.device.threads);
    renderer::RenderOptions draw;
    draw.threads = options_.device.threads;
    const auto renderer = renderer::make_cpu_renderer(surfels, draw, field);
    scene.field = field;
    scene.quality = reconstruction::held_out_quality(*renderer, set_, {{}, exposures_});
    const auto quality = scene.quality.listing();
    statistics_.insert(statistics_.end(), quality.begin(), quality.end());
    if (options_.align_held_out && !set_.held_out.empty()) {
      scene.aligned_quality = aligned_quality(*renderer, scene.surfels);
    }
    scene.statistics = std::move(statistics_);
    scene.refined_poses = poses_;
    return scene;
  }

 private:
  [[nodiscard]] std::string kept_state() const {
    return fs::exists(geometry_state())
               ? "the state in " + options_.work.string() + " is kept: --resume goes on there"
               : "there was no state to keep yet";
  }
  [[nodiscard]] std::string geometry_advice() const {
    return "fewer surfels: --voxel, geometry.densify.max_surfels; fewer frames: --frame-step; "
           "smaller images; " +
           kept_state();
  }
  [[nodiscard]] std::string head_advice() const {
    return "less at once: panoptic.sampling.pixels, max_surfels_per_pixel, "
           "panoptic.query.max_queries; " +
           kept_state();
  }
  [[nodiscard]] fs::path geometry_state() const { return options_.work / kGeometryState; }
  [[nodiscard]] fs::path head_state() const { return options_.work / kHeadState; }
  [[nodiscard]] fs::path joint_state() const { return options_.work / kJointState; }
  [[nodiscard]] fs::path head_mark() const { return options_.work / kHeadMark; }

  [[nodiscard]] bool out_of_time(double share) const {
    return options_.time_limit_s > 0.0 &&
           seconds_since(begin_) > share * options_.time_limit_s;
  }
  /// After the state has been written. @throws core::Interrupted
  void check_signal() const {
    support::StopOnSignal::check("the state in " + options_.work.string() +
                                 " is kept, and the same command goes on there "
                                 "(`segsim reconstruct`: with --resume)");
  }

  SurfelCloud train_geometry();
  /// An error of the input, such as a loss that is not finite, tells where the state is.
  template <class Action>
  auto naming_state(const Action& action) const {
    try {
      return action();
    } catch (const core::InputError& error) {
      throw core::InputError(std::string(error.what()) + "; " + kept_state());
    }
  }
  /// Writes the state, and the scene so far for people to look at.
  void keep(const reconstruction::GeometryTrainer& trainer);
  /// Takes the training views' poses from the trainer, if they were moved.
  void keep_poses(const reconstruction::GeometryTrainer& trainer);
  [[nodiscard]] reconstruction::HeldOutQuality aligned_quality(core::Renderer& renderer,
                                                               const SurfelCloud& surfels);
  void add_change(const std::string& prefix, const reconstruction::PoseChange& change);
  std::shared_ptr<const renderer::PanopticField> train_head(TrainedScene& scene);
  /// @return  Iterations that the loaded head has behind it; 0 without a state.
  std::int64_t load_head(reconstruction::PanopticHead& head);
  void save_head(const reconstruction::PanopticHead& head, std::int64_t iteration);

  const TrainingSet& set_;
  const SurfelCloud& start_;
  const TrainingOptions& options_;
  std::string identity_;
  Every preview_due_, checkpoint_due_;
  Clock::time_point begin_ = Clock::now();
  std::unique_ptr<LossTable> losses_;
  std::vector<std::pair<std::string, double>> statistics_;
  std::vector<core::CameraPose> poses_;  ///< Of the training views; empty: as recorded.
  std::vector<reconstruction::Exposure> exposures_;  ///< Of the training views, if trained.
  std::unique_ptr<reconstruction::GeometryTrainer> trainer_;  ///< In joint training, from
                                                              ///< train_geometry() on.
};

SurfelCloud TrainingRun::train_geometry() {
  const reconstruction::GeometryConfig& config = options_.config.geometry;
  auto owned = std::make_unique<reconstruction::GeometryTrainer>(
      set_, start_, config, options_.seed, options_.device);
  reconstruction::GeometryTrainer& trainer = *owned;
  if (options_.resume && fs::exists(geometry_state())) {
    trainer.load(geometry_state(), identity_);
    std::fprintf(stderr, "resumed at iteration %ld of %ld\n",
                 static_cast<long>(trainer.iteration()), static_cast<long>(config.iterations));
  }
  const Clock::time_point start = Clock::now();
  core::Progress progress("train shape and colour", config.iterations);
  std::int64_t done_here = 0;
  while (trainer.iteration() < config.iterations && !out_of_time(kGeometryShare) &&
         !support::StopOnSignal::requested()) {
    const reconstruction::GeometryStep step = naming_state([&] { return trainer.step(); });
    ++done_here;
    char note[96];
    std::snprintf(note, sizeof note, "colour %.4f depth %.4f normal %.4f, %ld k surfels",
                  step.color, step.depth, step.normal, static_cast<long>(step.surfels / 1000));
    progress.update(step.iteration, note);
    if (step.iteration % 10 == 0) {
      const double seconds = seconds_since(begin_);
      losses_->add("geometry", step.iteration, seconds, step.surfels, "color", step.color);
      losses_->add("geometry", step.iteration, seconds, step.surfels, "depth", step.depth);
      losses_->add("geometry", step.iteration, seconds, step.surfels, "normal", step.normal);
    }
    if (checkpoint_due_.due()) keep(trainer);
    if (preview_due_.due()) {
      write_preview(options_.work / "preview.png", set_,
                    std::make_shared<const SurfelCloud>(trainer.surfels()), nullptr,
                    options_.device.threads);
    }
  }
  progress.finish();
  if (done_here > 0) {
    keep(trainer);
    fs::remove(head_mark());  // A head learns on finished surfels only.
  }
  check_signal();
  const double seconds = seconds_since(start);
  statistics_.emplace_back("geometry_iterations", static_cast<double>(trainer.iteration()));
  statistics_.emplace_back("geometry_seconds", seconds);
  if (done_here > 0) {
    statistics_.emplace_back("geometry_steps_per_second",
                             static_cast<double>(done_here) / seconds);
  }
  keep_poses(trainer);
  exposures_ = trainer.exposures();
  if (options_.joint) trainer_ = std::move(owned);
  return trainer.surfels();
}

void TrainingRun::keep(const reconstruction::GeometryTrainer& trainer) {
  trainer.save(geometry_state(), identity_);
  write_so_far(options_.work, trainer.surfels(), set_, trainer.poses());
}

void TrainingRun::keep_poses(const reconstruction::GeometryTrainer& trainer) {
  const auto& rate = options_.config.geometry.rate;
  if (rate.pose_rotation <= 0.0 && rate.pose_translation <= 0.0) return;
  poses_ = trainer.poses();
  std::vector<core::CameraPose> recorded;
  for (const auto& view : set_.training) recorded.push_back(view.T_world_camera);
  add_change("pose", reconstruction::pose_change(recorded, poses_));
}

reconstruction::HeldOutQuality TrainingRun::aligned_quality(core::Renderer& renderer,
                                                            const SurfelCloud& surfels) {
  core::Progress progress("align held-out views",
                          static_cast<std::int64_t>(set_.held_out.size()));
  const std::vector<core::CameraPose> poses = reconstruction::align_views(
      set_.held_out, set_.intrinsics, surfels, options_.config.geometry, options_.device,
      [&](std::int64_t done, std::int64_t) { progress.update(done); });
  progress.finish();
  std::vector<core::CameraPose> recorded;
  for (const auto& view : set_.held_out) recorded.push_back(view.T_world_camera);
  add_change("held_out_pose", reconstruction::pose_change(recorded, poses));
  reconstruction::HeldOutQuality quality =
      reconstruction::held_out_quality(renderer, set_, {poses, exposures_});
  const auto listing = quality.listing("held_out_aligned_");
  statistics_.insert(statistics_.end(), listing.begin(), listing.end());
  return quality;
}

void TrainingRun::add_change(const std::string& prefix,
                             const reconstruction::PoseChange& change) {
  const double degrees = 180.0 / std::numbers::pi;
  statistics_.insert(statistics_.end(),
                     {{prefix + "_mean_shift_m", change.mean_m},
                      {prefix + "_largest_shift_m", change.largest_m},
                      {prefix + "_mean_turn_deg", change.mean_rad * degrees},
                      {prefix + "_largest_turn_deg", change.largest_rad * degrees}});
}

std::int64_t TrainingRun::load_head(reconstruction::PanopticHead& head) {
  if (!options_.resume || !fs::exists(head_state()) || !fs::exists(head_mark())) return 0;
  std::ifstream in(head_mark());
  std::string identity;
  std::int64_t iteration = 0;
  in >> identity >> iteration;
  if (!in || identity != identity_ || iteration < 0) {
    throw core::InputError::expected(head_mark().string(), "a state of this run",
                                     "that of a run with other options or data");
  }
  head.load(head_state());
  if (trainer_) {
    trainer_->load(joint_state(), identity_);
    head.move_surfels(trainer_->positions_m());
  }
  return iteration;
}

void TrainingRun::save_head(const reconstruction::PanopticHead& head, std::int64_t iteration) {
  // Without its mark a state is not used, so a kill in between costs time, not correctness.
  fs::remove(head_mark());
  head.save(head_state());
  if (trainer_) trainer_->save(joint_state(), identity_);
  core::write_file_atomically(
      head_mark(), [&](std::ostream& out) { out << identity_ << ' ' << iteration << '\n'; });
}

std::shared_ptr<const renderer::PanopticField> TrainingRun::train_head(TrainedScene& scene) {
  const Clock::time_point start = Clock::now();
  std::unique_ptr<reconstruction::PanopticViews> views;
  reconstruction::MovingSurfels* moving = nullptr;
  if (trainer_) {
    auto joint = reconstruction::make_joint_views(set_, *trainer_, options_.config.joint,
                                                  options_.device);
    moving = joint.get();
    views = std::move(joint);
  } else {
    views = reconstruction::make_training_views(set_, scene.surfels, options_.device, poses_);
  }
  const reconstruction::PanopticTrainingConfig& config = options_.config.panoptic;
  reconstruction::PanopticHeadInputs inputs;
  inputs.position_m = scene.surfels.position_m;
  inputs.R_world_surfel = scene.surfels.R_world_surfel;
  inputs.classes = set_.classes;
  inputs.frames = views->count();
  inputs.cuda_device = reconstruction::trains_on_gpu(options_.device) ? 0 : -1;
  reconstruction::prepare_head_inputs(options_.head, *views, config, options_.seed, inputs);
  const auto head = reconstruction::make_panoptic_head(options_.head, std::move(inputs),
                                                       config, options_.seed);

  reconstruction::PanopticTrainingRun run;
  run.config = config;
  run.classes = set_.classes;
  run.seed = options_.seed;
  run.first_iteration = load_head(*head);
  run.moving = moving;
  run.warp = options_.head == "panoptic-splatting" || config.loss.warp > 0.0;
  core::Progress progress("train labels", config.iterations);
  const auto surfels = std::make_shared<const SurfelCloud>(scene.surfels);
  run.on_progress = [&](const reconstruction::PanopticProgress& p) {
    char note[64];
    std::snprintf(note, sizeof note, "loss %.4f",
                  p.losses.empty() ? 0.0 : p.losses.back().value);
    progress.update(p.iteration, note);
    if (p.iteration % 10 == 0) {
      for (const reconstruction::NamedLoss& loss : p.losses) {
        losses_->add("labels", p.iteration, seconds_since(begin_),
                     static_cast<std::int64_t>(surfels->size()), loss.name, loss.value);
      }
    }
    if (checkpoint_due_.due()) save_head(*head, p.iteration);
    if (preview_due_.due()) {
      const auto seen =
          trainer_ ? std::make_shared<const SurfelCloud>(trainer_->surfels()) : surfels;
      write_preview(options_.work / "preview.png", set_, seen,
                    std::make_shared<const renderer::PanopticField>(head->result().field),
                    options_.device.threads);
      preview_due_.done();  // Of some heads a result takes clusters of all pixels.
    }
    return !out_of_time(1.0) && !support::StopOnSignal::requested();
  };
  const std::int64_t iterations =
      naming_state([&] { return train_panoptic(*views, *head, run); });
  progress.finish();
  save_head(*head, iterations);
  check_signal();

  if (trainer_) {
    scene.surfels = trainer_->surfels();
    exposures_ = trainer_->exposures();
  }
  reconstruction::PanopticResult result = head->result();
  scene.model = std::move(result.model);
  scene.surfels.semantic_feature = std::move(result.semantic_feature);
  scene.surfels.instance_feature = std::move(result.instance_feature);
  reconstruction::label_surfels(result.field, scene.surfels);
  scene.instances = reconstruction::instances_of(scene.surfels, scene.classes);
  statistics_.emplace_back("label_iterations", static_cast<double>(iterations));
  statistics_.emplace_back("label_seconds", seconds_since(start));
  return std::make_shared<const renderer::PanopticField>(std::move(result.field));
}

}  // namespace

TrainingSet load_set(const reconstruction::RgbdSequence& recording,
                     const TrainingOptions& options) {
  std::unique_ptr<reconstruction::MaskSet> masks;
  if (!options.masks.empty())
    masks = reconstruction::open_masks(options.masks, recording.classes());
  std::unique_ptr<core::Progress> progress;
  reconstruction::TrainingSet set = reconstruction::load_training_set(
      recording, masks.get(), options.set, [&](std::int64_t done, std::int64_t total) {
        if (!progress) progress = std::make_unique<core::Progress>("load frames", total);
        progress->update(done);
      });
  for (const std::string& warning : set.warnings) {
    std::fprintf(stderr, "warning: %s\n", warning.c_str());
  }
  return set;
}

void check_joint(const TrainingOptions& options) {
  if (!options.joint) return;
  const auto refuse = [](const std::string& wanted, const std::string& got) {
    throw core::InputError::expected("training labels and surfels together (joint)", wanted,
                                     got);
  };
  const std::vector<std::string> heads = reconstruction::joint_head_names();
  if (std::find(heads.begin(), heads.end(), options.head) == heads.end()) {
    std::string known;
    for (const std::string& head : heads) known += (known.empty() ? "" : " | ") + head;
    refuse("a head of queries: " + known, "\"" + options.head + "\"");
  }
  if (reconstruction::trains_on_gpu(options.device)) {
    refuse("the CPU (--backend cpu)", "a GPU");
  }
  const int most = options.config.panoptic.sampling.max_surfels_per_pixel;
  if (most != 0) {
    refuse("all surfels of a pixel (panoptic.sampling.max_surfels_per_pixel: 0)",
           std::to_string(most));
  }
}

std::string training_identity(const TrainingOptions& options, const TrainingSet& set,
                              const SurfelCloud& start) {
  std::string text = reconstruction::training_config_text(options.config);
  if (options.joint) text += "joint ";
  text += options.head + " seed " + std::to_string(options.seed) + " start " +
          core::sha256_hex(std::as_bytes(std::span(start.position_m))) + " masks " +
          fs::weakly_canonical(options.masks).string() + " size " +
          std::to_string(set.intrinsics.width_px) + " x " +
          std::to_string(set.intrinsics.height_px);
  for (const auto& view : set.training) {
    text += ' ' + view.name;
    if (view.sensor != reconstruction::DepthSensor::kUnstated) {
      text += " by " + reconstruction::words_of(view.sensor);
    }
  }
  return core::sha256_hex(text);
}

void remove_training_state(const fs::path& work) {
  for (const char* name :
       {kGeometryState, kHeadState, kJointState, kHeadMark, kSurfelsSoFar, kCamerasSoFar}) {
    fs::remove(work / name);
  }
}

TrainedScene train_scene(const TrainingSet& set, const SurfelCloud& start,
                         const TrainingOptions& options) {
  return TrainingRun(set, start, options).run();
}

}  // namespace segsim::experiments::training
