#include "experiments/training/mask_quality.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "core/error.h"
#include "core/formatted.h"
#include "core/progress.h"
#include "experiments/support/text_grid.h"
#include "reconstruction/datasets/mask_files.h"
#include "reconstruction/training/training_set.h"

namespace segsim::experiments::training {
namespace {

/// How far a share is from the wanted one: > 0 where more errors are wanted. In log odds, in
/// which errors scale.
double shortfall(double measured, double wanted) {
  const auto log_odds = [](double share) {
    const double s = std::clamp(share, 0.005, 0.995);
    return std::log((1.0 - s) / s);
  };
  return log_odds(wanted) - log_odds(measured);
}

/// `factor` raised by a step in log odds; damped, for the factors act on one another's
/// figures.
double adjusted(double factor, double step) {
  return std::clamp(factor * std::exp(std::clamp(0.8 * step, -0.9, 0.9)), 0.02, 20.0);
}

/// Exact labels of views spread over the recording.
std::vector<TrueLabels> sample_views(const reconstruction::RgbdSequence& recording) {
  constexpr std::size_t kViews = 64;
  const std::size_t n = std::min(kViews, recording.frame_count());
  std::vector<TrueLabels> views;
  core::Progress progress("read labels", static_cast<std::int64_t>(n));
  for (std::size_t k = 0; k < n; ++k) {
    views.push_back(load_true_labels(recording, k * recording.frame_count() / n));
    progress.update(static_cast<std::int64_t>(k) + 1);
  }
  return views;
}

worlds::MaskNoise fitted_noise(const MaskSimulation& simulation,
                               const reconstruction::RgbdSequence& recording) {
  const std::vector<TrueLabels> views = sample_views(recording);
  int round = 0;
  return fit_mask_noise(
      simulation.noise, recording.classes(), simulation.seed, recording.name(), views,
      recording.intrinsics(), published_quality(), 0.01,
      [&](const reconstruction::ViewQuality& reached) {
        std::fprintf(
            stderr, "fit, round %d: PQ %.3f, SQ %.3f, RQ %.3f, recall %.3f, precision %.3f\n",
            ++round, reached.pq, reached.sq, reached.rq, reached.recall, reached.precision);
      });
}

}  // namespace

TrueLabels load_true_labels(const reconstruction::RgbdSequence& recording, std::size_t i) {
  if (!recording.has_masks()) {
    throw core::InputError::expected(recording.name(), "a recording with exact labels",
                                     "none");
  }
  const reconstruction::RgbdFrame frame = recording.load(i);
  core::FrameMasks masks = reconstruction::exact_masks(frame);
  std::vector<reconstruction::Label> crowds = reconstruction::images_of(masks).crowds;
  return {std::move(masks.semantic), std::move(masks.instance), std::move(crowds),
          frame.T_world_camera, static_cast<std::uint32_t>(i)};
}

std::vector<std::pair<std::string, double>> MaskQuality::listing() const {
  return {{"pq", views.pq},
          {"sq", views.sq},
          {"rq", views.rq},
          {"recall", views.recall},
          {"precision", views.precision},
          {"mean_iou", views.mean_iou},
          {"mean_accuracy", views.mean_accuracy},
          {"mean_coverage", views.mean_coverage},
          {"true_segments", views.true_segments},
          {"predicted_segments", views.predicted_segments},
          {"labelled_share", views.labelled_share},
          {"views", static_cast<double>(views.views)},
          {"coco_pq", coco.pq},
          {"strict_scene_pq", strict.pq}};
}

MaskQuality mask_quality(const reconstruction::ContingencyTable& table,
                         std::span<const core::SceneClass> classes, int width_px) {
  MaskQuality quality;
  quality.views = reconstruction::view_quality(table, classes, {.width_px = width_px});
  quality.coco = reconstruction::panoptic_quality(
      table, classes, reconstruction::PanopticRules::coco_per_frame());
  quality.strict = reconstruction::panoptic_quality(table, classes,
                                                    reconstruction::PanopticRules::strict());
  return quality;
}

reconstruction::ViewQuality published_quality() {
  reconstruction::ViewQuality published;
  published.pq = 0.5350, published.sq = 0.8155, published.rq = 0.6511;
  published.mean_iou = 0.5466, published.mean_accuracy = 0.6237;
  published.mean_coverage = 0.5621;
  published.recall = 0.7276, published.precision = 0.6060;
  published.true_segments = 13.70, published.predicted_segments = 16.45;
  published.matches = 9.97;
  return published;
}

std::string mask_quality_text(const std::string& name, const MaskQuality& quality) {
  const auto percent = [](double share) { return core::print("%.1f", 100.0 * share); };
  const auto row = [&](const std::string& title, const reconstruction::ViewQuality& q) {
    return std::vector<std::string>{title,
                                    percent(q.pq),
                                    percent(q.sq),
                                    percent(q.rq),
                                    percent(q.recall),
                                    percent(q.precision),
                                    percent(q.mean_iou),
                                    percent(q.mean_accuracy),
                                    percent(q.mean_coverage),
                                    core::print("%.2f", q.true_segments),
                                    core::print("%.2f", q.predicted_segments),
                                    q.views == 0 ? "-" : percent(q.labelled_share)};
  };
  support::internal::TextGrid grid;
  grid.header = {"Masks, single views, IoU > 0.3",
                 "PQ",
                 "SQ",
                 "RQ",
                 "Recall",
                 "Precision",
                 "mIoU",
                 "mAcc",
                 "mCov",
                 "True/view",
                 "Masks/view",
                 "Labelled"};
  grid.rows = {row(name, quality.views),
               row("published (Grounded-SAM, ScanNet++)", published_quality())};
  return support::internal::text_of(grid) + "\nCOCO per-frame PQ (IoU > 0.5) " +
         percent(quality.coco.pq) + ", SQ " + percent(quality.coco.sq) + ", RQ " +
         percent(quality.coco.rq) + "; strict scene PQ " + percent(quality.strict.pq) +
         " with the ids as they are\n";
}

void ClassTranslation::apply(core::Image<std::uint16_t>& semantic,
                             core::Image<std::uint16_t>& instance) const {
  for (std::size_t i = 0; i < semantic.size(); ++i) {
    std::uint16_t& id = semantic.pixels()[i];
    id = id < id_of.size() ? id_of[id] : std::uint16_t{0};
    if (id == 0 && !instance.empty()) instance.pixels()[i] = 0;
  }
}

ClassTranslation translate_classes(std::span<const core::SceneClass> from,
                                   std::span<const core::SceneClass> to) {
  ClassTranslation translation;
  for (const core::SceneClass& c : from) {
    const auto same = std::find_if(
        to.begin(), to.end(), [&](const core::SceneClass& t) { return t.name == c.name; });
    if (translation.id_of.size() <= c.id) translation.id_of.resize(c.id + std::size_t{1});
    if (same == to.end()) {
      translation.unknown.push_back(c.name);
    } else {
      translation.id_of[c.id] = same->id;
    }
  }
  for (const core::SceneClass& c : to) {
    if (std::any_of(from.begin(), from.end(),
                    [&](const core::SceneClass& f) { return f.name == c.name; })) {
      translation.common.push_back(c.name);
    }
  }
  return translation;
}

std::vector<ClassRow> class_rows(const reconstruction::PanopticQuality& quality,
                                 std::span<const core::SceneClass> classes,
                                 const std::vector<std::string>& names) {
  std::vector<ClassRow> rows, means{{.name = "things"}, {.name = "stuff"}, {.name = "all"}};
  std::vector<int> counted(means.size(), 0);
  for (std::size_t k = 0; k < quality.classes.size(); ++k) {
    const reconstruction::ClassPanoptic& c = quality.classes[k];
    const std::string& name = classes[k].name;
    if (!c.counted || std::find(names.begin(), names.end(), name) == names.end()) continue;
    rows.push_back(
        {name, c.pq(), c.sq(), c.rq(), c.true_positives, c.false_positives, c.missed});
    for (const std::size_t m : {c.thing ? std::size_t{0} : std::size_t{1}, std::size_t{2}}) {
      means[m].pq += c.pq(), means[m].sq += c.sq(), means[m].rq += c.rq();
      means[m].true_positives += c.true_positives;
      means[m].false_positives += c.false_positives;
      means[m].missed += c.missed;
      ++counted[m];
    }
  }
  for (std::size_t m = 0; m < means.size(); ++m) {
    if (counted[m] == 0) continue;
    for (double* sum : {&means[m].pq, &means[m].sq, &means[m].rq}) *sum /= counted[m];
    rows.push_back(means[m]);
  }
  return rows;
}

std::string class_rows_text(const std::string& heading, const std::vector<ClassRow>& rows) {
  support::internal::TextGrid grid;
  grid.header = {heading, "PQ", "SQ", "RQ", "Found", "False", "Missed"};
  const auto percent = [](double share) { return core::print("%.1f", 100.0 * share); };
  for (const ClassRow& row : rows) {
    grid.rows.push_back({row.name, percent(row.pq), percent(row.sq), percent(row.rq),
                         std::to_string(row.true_positives),
                         std::to_string(row.false_positives), std::to_string(row.missed)});
  }
  return support::internal::text_of(grid);
}

worlds::MaskNoise fit_mask_noise(
    const worlds::MaskNoise& noise, const std::vector<core::SceneClass>& classes,
    std::uint64_t seed, const std::string& scene, std::span<const TrueLabels> views,
    const core::CameraIntrinsics& intrinsics, const reconstruction::ViewQuality& target,
    double tolerance, const std::function<void(const reconstruction::ViewQuality&)>& note) {
  constexpr int kRounds = 12;
  double misses = 1.0, false_positives = 1.0, shapes = 1.0;
  worlds::MaskNoise fitted = noise;
  for (int round = 0; round < kRounds; ++round) {
    fitted = noise.scaled(misses, false_positives, shapes);
    const worlds::MaskSimulator simulator(classes, fitted, seed, scene);
    reconstruction::ContingencyTable table;
    for (const TrueLabels& truth : views) {
      const core::FrameMasks masks = simulator.simulate(truth.view(intrinsics));
      table.add_frame(truth.images(), {masks.semantic, masks.instance});
    }
    const reconstruction::ViewQuality reached =
        reconstruction::view_quality(table, classes, {.width_px = intrinsics.width_px});
    note(reached);
    // Recall and precision follow from RQ and from their balance.
    const double balance = shortfall(reached.recall, target.recall) -
                           shortfall(reached.precision, target.precision);
    const double rq = shortfall(reached.rq, target.rq);
    const double sq = shortfall(reached.sq, target.sq);
    if (std::abs(reached.rq - target.rq) <= tolerance &&
        std::abs(reached.sq - target.sq) <= tolerance && std::abs(balance) <= 0.15) {
      break;
    }
    misses = adjusted(misses, rq + 0.5 * balance);
    false_positives = adjusted(false_positives, rq - 0.5 * balance);
    shapes = adjusted(shapes, sq);
  }
  return fitted;
}

std::string describe(const MaskSimulation& simulation) {
  return core::print("simulated, level %g", simulation.level) +
         (simulation.fit ? ", fitted" : "") + ", seed " + std::to_string(simulation.seed);
}

MaskQuality simulate_masks(
    const reconstruction::RgbdSequence& recording, const MaskSimulation& simulation,
    const std::filesystem::path& folder,
    const std::function<void(const TrueLabels&, const core::FrameMasks&)>& on_view) {
  std::filesystem::remove(folder / "masks.yaml");  // Until it is complete again.
  const worlds::MaskNoise noise =
      (simulation.fit ? fitted_noise(simulation, recording) : simulation.noise)
          .at_level(simulation.level);
  const worlds::MaskSimulator simulator(recording.classes(), noise, simulation.seed,
                                        recording.name());
  const std::size_t step = static_cast<std::size_t>(simulation.frame_step);
  const std::size_t views = (recording.frame_count() + step - 1) / step;
  reconstruction::ContingencyTable table;
  core::Progress progress("simulate masks", static_cast<std::int64_t>(views));
  for (std::size_t k = 0; k < views; ++k) {
    const TrueLabels truth = load_true_labels(recording, k * step);
    const core::FrameMasks masks = simulator.simulate(truth.view(recording.intrinsics()));
    table.add_frame(truth.images(), {masks.semantic, masks.instance});
    reconstruction::write_masks(folder, recording.frame_name(k * step), masks,
                                recording.classes());
    if (on_view) on_view(truth, masks);
    progress.update(static_cast<std::int64_t>(k) + 1);
  }
  progress.finish();
  MaskQuality quality =
      mask_quality(table, recording.classes(), recording.intrinsics().width_px);
  reconstruction::MaskSetInfo info;
  info.source = describe(simulation) + ", of " + recording.name();
  info.classes = recording.classes();
  info.settings = noise.listing();
  info.measured = quality.listing();
  reconstruction::write_mask_set_info(folder, info);
  return quality;
}

}  // namespace segsim::experiments::training
