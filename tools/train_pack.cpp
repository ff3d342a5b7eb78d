/// @file
/// Training on a bare GPU machine: a training pack (reconstruction/training/training_pack.h)
/// goes in, times and the quality on held-out views come out. What `segsim reconstruct
/// --backend cuda` does, without the libraries that a recording needs.
///
///     train_pack PACK [--geometry 7000] [--labels 15000] [--head query] [--max-surfels N]
///                [--masks PACK2]... [--sh 2] [--exposure 0.001] [--pose-rate 0.001]
///                [--loss-depth 0.1] [--loss-normal 0.05] [--position-rate 1]
///                [--fixed-order] [--start IN.ply] [--out OUT.ply] [--record NEW.json]
///
/// `segsim reconstruct --export-pack` writes packs, and `--start OUT.ply --iterations 0` makes
/// a bundle of what comes back. --exposure is the rate of every image's gain, --pose-rate
/// that of its pose [rad and m]; --position-rate is a factor on that of positions. --start
/// takes other surfels than the pack's, --out keeps the trained ones; --masks trains the
/// labels once more with the masks of another pack of the same views; --record saves times and
/// quality for results/ (results/README.md).

#include <chrono>
#include <cstdio>
#include <memory>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "core/error.h"
#include "core/file_io.h"
#include "core/process/measurement_record.h"
#include "reconstruction/labels/panoptic_training.h"
#include "reconstruction/training/geometry_training.h"
#include "reconstruction/training/pose_alignment.h"
#include "reconstruction/training/training_evaluation.h"
#include "reconstruction/training/training_pack.h"
#include "reconstruction/training/training_views.h"
#include "renderer/cuda/cuda_renderer.h"
#include "renderer/files/ply_io.h"

namespace segsim {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

struct Flags {
  std::string pack, head = "query", start, out, record;
  std::vector<std::string> masks;
  reconstruction::GeometryConfig geometry;
  std::int64_t label_iterations = 15000;
  bool fixed_order = false;
};

Flags parse(int argc, char** argv) {
  Flags flags;
  flags.geometry.iterations = 7000;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const auto value = [&]() -> std::string {
      if (i + 1 >= argc) throw core::InputError::expected(word, "a value", "nothing");
      return argv[++i];
    };
    if (word == "--geometry") {
      flags.geometry.iterations = std::stoll(value());
    } else if (word == "--labels") {
      flags.label_iterations = std::stoll(value());
    } else if (word == "--head") {
      flags.head = value();
    } else if (word == "--max-surfels") {
      flags.geometry.densify.max_surfels = std::stoll(value());
    } else if (word == "--sh") {
      flags.geometry.sh_degree = std::stoi(value());
    } else if (word == "--exposure") {
      flags.geometry.rate.exposure = std::stod(value());
    } else if (word == "--loss-depth") {
      flags.geometry.loss.depth = std::stod(value());
    } else if (word == "--loss-normal") {
      flags.geometry.loss.normal = std::stod(value());
    } else if (word == "--position-rate") {
      const double factor = std::stod(value());
      flags.geometry.rate.position *= factor;
      flags.geometry.rate.position_final *= factor;
    } else if (word == "--pose-rate") {
      flags.geometry.rate.pose_rotation = std::stod(value());
      flags.geometry.rate.pose_translation = flags.geometry.rate.pose_rotation;
    } else if (word == "--masks") {
      flags.masks.push_back(value());
    } else if (word == "--start") {
      flags.start = value();
    } else if (word == "--out") {
      flags.out = value();
    } else if (word == "--record") {
      flags.record = value();
    } else if (word == "--fixed-order") {
      flags.fixed_order = true;
    } else if (flags.pack.empty() && word.rfind("--", 0) != 0) {
      flags.pack = word;
    } else {
      throw core::InputError::expected("command line", "an option of train_pack", word);
    }
  }
  if (flags.pack.empty()) {
    throw core::InputError::expected("command line", "a training pack", "none");
  }
  return flags;
}

std::string geometry_case(const Flags& flags) {
  return std::to_string(flags.geometry.iterations) + " steps of shape and colour";
}

void add_time(const std::string& case_name, std::int64_t steps, double seconds,
              core::MeasurementRecord& record) {
  if (steps == 0) return;
  record.values.push_back({case_name, "time", "s", seconds});
  record.values.push_back({case_name, "steps/s", "", static_cast<double>(steps) / seconds});
}

/// Moves the poses of pack.set.training with --pose-rate.
renderer::SurfelCloud train_geometry(reconstruction::TrainingPack& pack, const Flags& flags,
                                     const reconstruction::GeometryDevice& device,
                                     reconstruction::TrainedCamera& camera,
                                     core::MeasurementRecord& record) {
  reconstruction::GeometryTrainer trainer(pack.set, pack.start, flags.geometry, 1, device);
  const Clock::time_point start = Clock::now();
  reconstruction::GeometryStep step;
  while (trainer.iteration() < flags.geometry.iterations) {
    step = trainer.step();
    if (step.iteration % 1000 == 0) {
      std::printf("%6ld  %6.1f s  colour %.4f depth %.4f normal %.4f  %ld surfels\n",
                  static_cast<long>(step.iteration), seconds_since(start), step.color,
                  step.depth, step.normal, static_cast<long>(step.surfels));
    }
  }
  const double seconds = seconds_since(start);
  std::printf("geometry: %ld steps in %.1f s, %.1f steps/s\n",
              static_cast<long>(step.iteration), seconds,
              static_cast<double>(step.iteration) / seconds);
  add_time(geometry_case(flags), step.iteration, seconds, record);
  if (flags.geometry.rate.pose_rotation > 0.0) {
    for (std::size_t i = 0; i < pack.set.training.size(); ++i) {
      pack.set.training[i].T_world_camera = trainer.poses()[i];
    }
  }
  camera.exposures = trainer.exposures();
  return trainer.surfels();
}

/// Prints it, and adds it to the record in the row `case_name`.
void note_quality(const std::string& case_name, const reconstruction::TrainingSet& set,
                  const std::shared_ptr<const renderer::SurfelCloud>& surfels,
                  const std::shared_ptr<const renderer::PanopticField>& field, int top_k,
                  const reconstruction::TrainedCamera& camera,
                  core::MeasurementRecord& record) {
  renderer::RenderOptions options;
  options.top_k = top_k;
  const auto gpu = renderer::make_cuda_renderer(surfels, options, field);
  const reconstruction::HeldOutQuality quality =
      reconstruction::held_out_quality(*gpu, set, camera);
  std::printf("%s: %s\n", case_name.c_str(), quality.text().c_str());
  for (const core::MeasuredValue& value : quality.measured(case_name)) {
    record.values.push_back(value);
  }
}

/// @param masks  Where they come from, in words.
void train_labels(const std::string& masks, const reconstruction::TrainingSet& set,
                  const std::shared_ptr<const renderer::SurfelCloud>& surfels,
                  const reconstruction::TrainedCamera& camera, const Flags& flags,
                  const reconstruction::GeometryDevice& device,
                  core::MeasurementRecord& record) {
  reconstruction::PanopticTrainingConfig config;
  config.iterations = flags.label_iterations;
  const Clock::time_point start = Clock::now();
  const auto views = reconstruction::make_training_views(set, *surfels, device);
  reconstruction::PanopticHeadInputs inputs;
  inputs.position_m = surfels->position_m;
  inputs.R_world_surfel = surfels->R_world_surfel;
  inputs.classes = set.classes;
  inputs.frames = views->count();
  reconstruction::prepare_head_inputs(flags.head, *views, config, 1, inputs);
  inputs.cuda_device = 0;
  std::printf("%zu query seeds\n", inputs.query_seeds.size());
  const auto head =
      reconstruction::make_panoptic_head(flags.head, std::move(inputs), config, 1);
  reconstruction::PanopticTrainingRun run;
  run.config = config;
  run.classes = set.classes;
  run.seed = 1;
  run.warp = flags.head == "panoptic-splatting";
  run.on_progress = [&](const reconstruction::PanopticProgress& p) {
    if (p.iteration % 1000 == 0) {
      std::printf("%6ld  %6.1f s ", static_cast<long>(p.iteration), seconds_since(start));
      for (const auto& loss : p.losses) std::printf(" %s %.4f", loss.name.c_str(), loss.value);
      std::printf("\n");
    }
    return true;
  };
  reconstruction::train_panoptic(*views, *head, run);
  const double seconds = seconds_since(start);
  std::printf("labels: %ld steps in %.1f s\n", static_cast<long>(config.iterations), seconds);
  const std::string name =
      masks + ", head " + flags.head + ", " + std::to_string(config.iterations) + " steps";
  add_time(name, config.iterations, seconds, record);
  reconstruction::PanopticResult result = head->result();
  renderer::SurfelCloud labelled = *surfels;
  labelled.semantic_feature = std::move(result.semantic_feature);
  labelled.instance_feature = std::move(result.instance_feature);
  const auto shared = std::make_shared<const renderer::SurfelCloud>(std::move(labelled));
  const auto field = std::make_shared<const renderer::PanopticField>(std::move(result.field));
  for (const int top_k : {24, 4, 3, 1}) {
    note_quality(name + ", K = " + std::to_string(top_k), set, shared, field, top_k, camera,
                 record);
  }
}

void save_record(const std::string& file, const core::MeasurementRecord& record) {
  if (file.empty()) return;
  core::write_file_atomically(file,
                              [&](std::ostream& out) { out << core::record_text(record); });
}

void run(const Flags& flags) {
  const Clock::time_point start = Clock::now();
  reconstruction::TrainingPack pack = reconstruction::read_training_pack(flags.pack);
  if (!flags.start.empty()) pack.start = renderer::read_surfels_ply(flags.start);
  std::printf("%zu training views, %zu held out, %zu surfels, read in %.1f s\n",
              pack.set.training.size(), pack.set.held_out.size(), pack.start.size(),
              seconds_since(start));
  const reconstruction::GeometryDevice device{.backend = renderer::Backend::kCuda,
                                              .deterministic = flags.fixed_order};
  core::MeasurementRecord record{"Training of a packed scene on the GPU", true, {}};
  note_quality("start", pack.set, std::make_shared<const renderer::SurfelCloud>(pack.start),
               nullptr, 4, {}, record);
  reconstruction::TrainedCamera camera;
  const auto surfels = std::make_shared<const renderer::SurfelCloud>(
      train_geometry(pack, flags, device, camera, record));
  if (!flags.out.empty()) renderer::write_surfels_ply(flags.out, *surfels);
  record.values.push_back(
      {geometry_case(flags), "surfels", "", static_cast<double>(surfels->size())});
  note_quality(geometry_case(flags), pack.set, surfels, nullptr, 4, camera, record);
  if (flags.geometry.rate.pose_rotation > 0.0) {
    camera.held_out_poses = reconstruction::align_views(pack.set.held_out, pack.set.intrinsics,
                                                        *surfels, flags.geometry, device);
    note_quality(geometry_case(flags) + ", held-out poses aligned", pack.set, surfels, nullptr,
                 4, camera, record);
  }
  if (flags.label_iterations > 0) {
    train_labels("masks of the pack", pack.set, surfels, camera, flags, device, record);
    for (const std::string& file : flags.masks) {
      std::printf("masks of %s\n", file.c_str());
      train_labels("masks of " + file, reconstruction::read_training_pack(file).set, surfels,
                   camera, flags, device, record);
    }
  }
  save_record(flags.record, record);
}

}  // namespace
}  // namespace segsim

int main(int argc, char** argv) {
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  try {
    segsim::run(segsim::parse(argc, argv));
    return 0;
  } catch (const segsim::core::InputError& error) {
    std::fprintf(stderr, "train_pack: %s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "train_pack: %s\n", error.what());
    return 3;
  }
}
