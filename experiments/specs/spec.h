#pragma once

/// @file
/// One experiment as written in YAML: scenes, arms, robot, camera, success rule. A spec is all
/// that `segsim run` needs besides the folder with the data. experiments/specs/ has complete
/// examples.
///
/// Paths may use ${data} (flag --data), ${work} (flag --work, default out/<name>) and ${spec}
/// (the folder of the spec file).

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/config.h"
#include "experiments/specs/clock_spec.h"
#include "experiments/specs/rig_spec.h"
#include "experiments/specs/sensor_spec.h"
#include "nav/policies/policy_registry.h"
#include "renderer/renderer_backend.h"
#include "sim/gazebo/gazebo_drive.h"
#include "sim/ground/robot.h"
#include "sim/trial/success_profile.h"
#include "sim/trial/trial.h"
#include "worlds/mesh/gazebo/gazebo_options.h"
#include "worlds/procedural/home_kinds.h"

namespace segsim::experiments::specs {

/// Views taken of a mesh world, as if somebody walked through it with an RGB-D camera.
struct CaptureSpec {
  int frames = 240;
  int width_px = 640, height_px = 480;
  double hfov_deg = 90.0;
  double camera_height_m = 1.4;
};

enum class SourceType : std::uint8_t {
  kFlat,    ///< Procedural flat, `seed`.
  kGazebo,  ///< Gazebo world, `world`.
  kMesh,    ///< Any mesh file, `world`.
  kRgbd,  ///< Recorded RGB-D sequence, `folder`; labels from `boxes` if the frames have none.
  kHome,  ///< Procedural home, `seed` and `home`.
};
[[nodiscard]] const char* to_string(SourceType type);

/// Training of a scene after lifting (docs/training.md).
struct ReconstructSpec {
  std::filesystem::path config;  ///< Weights and rates; empty: the defaults.
  std::int64_t iterations = -1, label_iterations = -1;  ///< < 0: the configuration's.
  std::string head = "query";                           ///< What learns labels, or "none".
  std::uint64_t seed = 1;
};

/// How a Gazebo world is read; see docs/worlds.md.
struct GazeboSpec {
  worlds::GazeboImportOptions options;
  std::filesystem::path class_map;  ///< Corrections of class names; empty: none.
};

/// Where the masks come from that a scene's labels for fine-tuning are learnt from. Without it
/// they are the recording's own labels, by which success is judged in any case.
enum class MaskSource : std::uint8_t {
  kSimulate,  ///< The recording's labels, spoilt as a segmenter spoils them.
  kFolder,    ///< Of whatever segmenter (docs/masks.md).
  kDetect,    ///< Boxes of a detector, cut out by depth and colour.
};
struct MaskSpec {
  MaskSource source = MaskSource::kSimulate;
  double level = 1.0;              ///< kSimulate: 1 is as noisy as published.
  bool fit = false;                ///< kSimulate: first scale the noise to what is published.
  std::uint64_t seed = 1;          ///< kSimulate.
  std::filesystem::path folder;    ///< kFolder.
  std::filesystem::path detector;  ///< kDetect: weights, or a model of others.
  std::string prompt;              ///< kDetect: "chair. couch."; empty: all of its classes.
  std::optional<float> score_threshold;  ///< kDetect: default: the detector's own.
};

/// What a scene bundle is made from if it does not exist yet.
/// Which procedural home; see docs/homes.md.
struct HomeSpec {
  worlds::HomePlan plan = worlds::HomePlan::kAny;
  int rooms = 0;                                               ///< 0 = chosen by the seed.
  worlds::FurniturePool pool = worlds::FurniturePool::kTrain;  ///< Of the library's models.
  bool own_furniture = false;              ///< Shapes of our own, whatever is installed.
  std::filesystem::path furniture_folder;  ///< Empty: that of Debian's package.
};

struct SourceSpec {
  SourceType type = SourceType::kFlat;
  std::uint64_t seed = 0;                ///< kFlat, kHome.
  std::filesystem::path world;           ///< kGazebo, kMesh: a file.
  GazeboSpec gazebo;                     ///< kGazebo.
  HomeSpec home;                         ///< kHome.
  std::filesystem::path folder;          ///< kRgbd.
  std::filesystem::path boxes;           ///< kRgbd: 3-D boxes (JSON); empty if none.
  CaptureSpec capture;                   ///< All but kRgbd.
  int frame_step = 1;                    ///< kRgbd: every n-th frame is used.
  std::optional<double> floor_height_m;  ///< kRgbd: along the source's up axis; none = fitted.
  RigSpec rig;                           ///< kRgbd.
  double voxel_m = 0.02;                 ///< Lifting resolution.
  std::optional<ReconstructSpec> reconstruct;  ///< None: lifting alone.
  std::optional<MaskSpec> masks;  ///< Only with `reconstruct`: by training masks agree.
};

/// A goal in words, which an image-text model finds in the scene (docs/episodes.md).
struct PhraseSpec {
  std::string text;   ///< "a red chair".
  int instances = 1;  ///< How many things of the scene it means.
};

struct SceneSpec {
  std::string name;        ///< Unique; letters, digits, '-', '_', '.': it names folders.
  std::string family;      ///< The name in the spec: of all reconstructions of the scene.
  int reconstruction = 1;  ///< Which of them this is; from 2 on `name` is "<family>.r2", ...
  std::string title;       ///< For tables.
  std::string pool;        ///< Of scenes that a table puts into one row; empty: none.
  std::filesystem::path bundle;      ///< Default: ${work}/scenes/<name>.
  std::optional<SourceSpec> source;  ///< None: the bundle must exist.
  std::vector<std::string> goals;    ///< Class names to search for.
  std::vector<PhraseSpec> phrases;   ///< To search for as well.
  int episodes = 20;                 ///< Over all goals.
  /// A set to run instead of generated episodes (docs/episodes.md); empty: generate.
  std::filesystem::path episode_file;
  bool allow_trivial = false;    ///< Run episodes that begin on a view point, too.
  double camera_height_m = 1.2;  ///< Of the robot's camera in this scene; else the robot's.
  double min_start_distance_m = 2.0, max_start_distance_m = 15.0;  ///< Geodesic, to the goal.
  bool allow_visible_start = false;  ///< The goal may be in view at the start.
};

/// Training of the detector before it has seen any of the scenes.
struct PretrainSpec {
  std::uint64_t seed = 1;
  int rooms = 24, views_per_room = 40;
  int steps = 2000;
};

/// Fine-tuning of the detector on views rendered from reconstructed scenes.
struct FinetuneSpec {
  std::uint64_t seed = 2;  ///< Of the first training, and of the held-out views of all.
  std::vector<std::string>
      scenes;     ///< Names; default all. A scene listed here *leaks* into its own trials.
  int folds = 0;  ///< Of `after-elsewhere` over `scenes`; 0: each scene is one.
  int views_per_scene = 200;
  int width_px = 0, height_px = 0;  ///< Of the views; 0 = as the robot's camera.
  int steps = 600;
  double learning_rate = 0.0;  ///< 0 = that of the recipe for the network of `before`.
  /// Share of every batch that comes from the source domain, against forgetting; 0 = none.
  double mix_share = 0.0;
  int mix_rooms = 100;  ///< Plain rooms that are rendered for it, eight views each.
  /// Of the training views, those that try to face an object; the rest look anywhere, so that
  /// the detector sees places without goals, too.
  double facing_share = 0.85;
  /// Views on which the score thresholds are chosen, and as many others for AP50; 0 = one for
  /// five training views. A robot that searches seldom faces an object, so they may be drawn
  /// with another share than the training views.
  int validation_views_per_scene = 0;
  double validation_facing_share = 0.85;
  /// Whether AP50 is also measured in rooms of the source domain and in homes never seen: what
  /// tuning costs there.
  bool measure_elsewhere = true;
  /// Of the thresholds of this precision the one that finds most; 0 = that of best F1.
  double precision_target = 0.0;
  /// No view is taken nearer than this to where an evaluation episode starts; 0 = anywhere.
  double start_clearance_m = 0.0;
  int threads = 1;  ///< Of each training; `workers` / `threads` trainings run side by side.
};

struct DetectorSpec {
  std::filesystem::path
      before;  ///< Weights; default ${work}/detector-before.bin, made by `pretrain`.
  std::optional<PretrainSpec> pretrain;  ///< If `before` does not exist.
  std::filesystem::path
      after;  ///< Weights; default ${work}/detector-after.bin, made by `finetune`.
  std::optional<FinetuneSpec> finetune;  ///< If `after` does not exist.
};

/// Which detector an arm runs.
enum class ArmDetector : std::uint8_t {
  kBefore,
  kAfter,
  kOracle,
  kFile,
  kAfterHere,       ///< tuning_set.h
  kAfterElsewhere,  ///< tuning_set.h
  kAfterExact,      ///< tuning_set.h
  kProcess
};

/// One arm of the spec is an arm here for each of its trainings and reconstructions.
struct ArmSpec {
  std::string name;        ///< Unique, for example "before", "after.s3", "before.r2".
  std::string family;      ///< The name in the spec.
  int reconstruction = 1;  ///< It runs in these scenes only.
  ArmDetector detector = ArmDetector::kOracle;
  std::optional<std::uint64_t> finetune_seed;  ///< If this run fine-tunes its detector.
  std::filesystem::path weights;               ///< kFile.
  core::PeerCommand process;                   ///< kProcess.
  std::optional<double> score_threshold;       ///< None: the one stored with the weights.
  /// A second detector, which is asked for what the first does not know: a model of others
  /// (docs/models.md). Empty: none.
  std::filesystem::path open_detector;
  std::vector<std::string> open_targets;    ///< Goals that are its own in any case.
  std::optional<nav::PolicyChoice> policy;  ///< None: the spec's.
  ArmClockSpec clock;
};

struct SuccessSpec {
  std::string profile = "segsim-object";
  double distance_m = 1.0;  ///< STOP must be this near to a view point (geodesic).
  bool require_visible = true;
  int visible_pixels = 40;  ///< Of a goal instance, in the final view.
  /// The named rule with these numbers.
  [[nodiscard]] sim::SuccessProfile rule() const;
};

struct CameraSpec {
  int width_px = 320, height_px = 240;
  double hfov_deg = 70.0;
  double pitch_down_deg = 0.0;
  double depth_range_m = 6.0;
  /// That draws the camera's view; kAuto falls back to the CPU with one warning. Default: the
  /// spec's.
  renderer::Backend backend = renderer::Backend::kCpu;
  [[nodiscard]] core::CameraIntrinsics intrinsics() const;
  [[nodiscard]] double pitch_down_rad() const;
};

/// What is recorded: of kFirst, each scene's first episode by the first training of each arm.
enum class Recorded : std::uint8_t { kNone, kFirst, kAll };

/// OpenEXR sequences of what the camera saw, ${work}/frames/<scene>/<episode>.<arm>/.
struct FramesSpec {
  Recorded of = Recorded::kNone;
  double every_s = 1.0;  ///< Simulated time from one frame to the next, in whole ticks.
};

/// Logs for `segsim replay`, ${work}/replays/<scene>/<episode>.<arm>.jsonl.
struct ReplaysSpec {
  Recorded of = Recorded::kAll;
  bool images = false;  ///< Also depth and labels of every image: replays need no renderer.
};

/// What finds the things that phrases mean.
struct PhraseModelSpec {
  std::filesystem::path model;  ///< Description of an image-text model; empty: no phrases.
  int views = 4;                ///< Of each thing.
};

/// How often what is random is drawn again (docs/simulation.md, "Repetitions").
struct RepetitionsSpec {
  int trials = 1;             ///< Of each episode by each arm.
  int finetune_seeds = 1;     ///< Trainings of 'after' in each reconstruction.
  int reconstruct_seeds = 1;  ///< Reconstructions of each scene.
};

/// Scenes and arms are those of the file once for each reconstruction and each training: what
/// comes first keeps its name, so that a spec without repetitions is taken as it stands.
struct ExperimentSpec {
  static constexpr const char* kSchema = "segsim.experiment/1";

  std::string name;
  std::string title;
  std::uint64_t seed = 1;
  std::vector<SceneSpec> scenes;
  PhraseModelSpec phrases;
  DetectorSpec detectors;
  std::vector<ArmSpec> arms;
  /// Of arms without one of their own.
  nav::PolicyChoice policy = nav::PolicyRegistry::instance().usual("frontier");
  sim::RobotModel robot = sim::RobotModel::jackal();
  LocalisationSpec localisation;
  std::optional<sim::SensorSettings> sensors;  ///< None: an exact camera alone.
  bool slide_on_contact = false;               ///< Along the obstacle; else it stops.
  sim::CollisionMode collision = sim::CollisionMode::kFootprint;
  double control_period_s = 0.1;
  double time_limit_s = 180.0;
  ClockSpec clock;
  /// That Gazebo moves the robot; none: this program does.
  std::optional<sim::GazeboDriveOptions> motion;
  RepetitionsSpec repetitions;
  CameraSpec camera;
  SuccessSpec success;
  int planned_n = 0;  ///< Episodes per arm that the conclusion was planned for; 0 = all.
  Recorded videos = Recorded::kNone;
  FramesSpec frames;
  ReplaysSpec replays;
  bool pictures = true;  ///< A PNG per trial.
  /// That trains scenes and detectors, runs detectors and draws robots' views (these unless
  /// `camera` names another). Not kAuto: a GPU has other last digits.
  renderer::Backend backend = renderer::Backend::kCpu;

  std::filesystem::path file;  ///< It was read from.
  std::string text;            ///< The YAML itself.
  std::string sha256;          ///< Of `text` and of the budgets that it names.

  /// nullptr if there is none.
  [[nodiscard]] const SceneSpec* find_scene(const std::string& scene_name) const;
  [[nodiscard]] const ArmSpec* find_arm(const std::string& arm_name) const;
  /// Whether the arm's detector was fine-tuned on the scene, in this reconstruction.
  [[nodiscard]] bool leaks(const ArmSpec& arm, const SceneSpec& scene) const;
};

/// What tells names of files of a reconstruction and a training from those of the first:
/// empty,
/// ".r2", ".s3" or ".r2.s3". @param finetune_seed  None: of the reconstruction as a whole.
[[nodiscard]] std::string repetition_suffix(const ExperimentSpec& spec, int reconstruction,
                                            std::optional<std::uint64_t> finetune_seed);

/// Values of the variables in paths.
struct SpecFolders {
  std::filesystem::path data;  ///< Empty: ${data} is an error.
  std::filesystem::path work;  ///< Empty: out/<name>.
};

/// Reads and checks a spec. `folders.work` is filled in if it was empty.
/// @throws core::InputError with file, line and key.
[[nodiscard]] ExperimentSpec load_spec(const std::filesystem::path& file,
                                       SpecFolders& folders);
/// The same from memory; `origin` stands for the file in messages and in ${spec}.
[[nodiscard]] ExperimentSpec parse_spec(const std::string& text,
                                        const std::filesystem::path& origin,
                                        SpecFolders& folders);

/// The text of a spec with its key `backend`, as if the file said so. A text that has the key
/// is refused when it is read.
[[nodiscard]] std::string with_backend(std::string text, renderer::Backend backend);

/// A `source:` section alone, for other files that name scenes.
/// @param file  That it stands in: ${spec} is its folder.
[[nodiscard]] SourceSpec read_source_spec(const core::ConfigNode& node,
                                          const SpecFolders& folders,
                                          const std::filesystem::path& file);
/// The `camera:` section of a file; the defaults if it has none.
[[nodiscard]] CameraSpec read_camera_spec(const core::ConfigNode& root);
/// The key `collision: footprint | navmesh`; footprint if it is absent.
[[nodiscard]] sim::CollisionMode read_collision_mode(const core::ConfigNode& root);
/// A path with its variables replaced.
[[nodiscard]] std::filesystem::path read_spec_path(const core::ConfigNode& node,
                                                   const SpecFolders& folders,
                                                   const std::filesystem::path& file);

}  // namespace segsim::experiments::specs
