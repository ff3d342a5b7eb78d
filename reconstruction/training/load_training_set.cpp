#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "core/check.h"
#include "core/error.h"
#include "reconstruction/lifting/lifting.h"
#include "reconstruction/lifting/parallel_loading.h"
#include "reconstruction/training/training_set.h"
#include "renderer/scene/parallel.h"

namespace segsim::reconstruction {
namespace {

constexpr std::size_t kBatch = 8;  ///< Frames between two reports.

TrainingView load_view(const RgbdSequence& recording, const MaskSet* masks, std::size_t frame,
                       const TrainingSetOptions& options, bool with_labels) {
  RgbdFrame source = recording.load(frame);
  TrainingView view;
  view.frame = frame;
  view.name = source.name;
  view.T_world_camera = source.T_world_camera;
  const int width = recording.intrinsics().width_px, height = recording.intrinsics().height_px;
  if (with_labels && masks != nullptr) {
    view.masks = masks->read(view.name, width, height);
  } else if (with_labels && recording.has_masks()) {
    view.masks = exact_masks(source);
  }
  view.rgb = std::move(source.rgb);
  view.depth_m = depth_of_size(source.depth_m, width, height);
  view.sensor = recording.sensor();
  view.valid = std::move(source.valid);
  return options.shrink > 1 ? shrunk(view, options.shrink) : view;
}

/// Loads the given frames in order, several at a time.
template <class Load>
void load_all(const std::vector<std::size_t>& frames, std::vector<TrainingView>& views,
              const Load& load, const std::function<void(std::size_t)>& report) {
  views.resize(frames.size());
  for (std::size_t first = 0; first < frames.size(); first += kBatch) {
    const std::size_t count = std::min(kBatch, frames.size() - first);
    internal::load_each(count,
                        [&](std::size_t k) { views[first + k] = load(frames[first + k]); });
    report(first + count);
  }
}

/// FNV-1a of the picture.
std::uint64_t picture_hash(const core::Image<core::Rgb8>& rgb) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (const core::Rgb8& px : rgb.pixels()) {
    for (const std::uint8_t byte : {px.r, px.g, px.b}) {
      hash = (hash ^ byte) * 0x100000001b3ULL;
    }
  }
  return hash;
}

bool is_plain(const core::Image<core::Rgb8>& rgb) {
  return std::all_of(rgb.pixels().begin(), rgb.pixels().end(),
                     [&](const core::Rgb8& px) { return px == rgb.data()[0]; });
}

bool same_pose(const core::CameraPose& a, const core::CameraPose& b) {
  constexpr double kSame = 1e-6;
  const glm::dvec3 d_m = a.translation_m() - b.translation_m();
  const glm::dquat q = glm::conjugate(a.rotation()) * b.rotation();
  return std::max({std::abs(d_m.x), std::abs(d_m.y), std::abs(d_m.z), std::abs(q.x),
                   std::abs(q.y), std::abs(q.z)}) < kSame;
}

/// Leaves out views that repeat others. Held-out ones are known first, so they stay.
class Duplicates {
 public:
  explicit Duplicates(std::vector<std::string>& warnings) : warnings_(warnings) {}

  void remove(std::vector<TrainingView>& views) {
    std::vector<std::uint64_t> hashes(views.size());
    renderer::internal::parallel_for_each(
        views.size(), 1, [&](std::size_t i) { hashes[i] = picture_hash(views[i].rgb); });
    std::vector<TrainingView> kept;
    kept.reserve(views.size());  // known_ keeps pointers to the pictures' memory.
    for (std::size_t i = 0; i < views.size(); ++i) {
      const Known* same = find(hashes[i], views[i].rgb);
      if (same != nullptr && same_pose(same->T_world_camera, views[i].T_world_camera)) {
        warnings_.push_back("frame " + views[i].name + " left out: it repeats frame " +
                            same->name + ", picture and pose");
        continue;
      }
      if (same != nullptr && !is_plain(views[i].rgb)) {
        warnings_.push_back("frames " + same->name + " and " + views[i].name +
                            " are one picture with two poses");
      }
      kept.push_back(std::move(views[i]));
      known_.emplace(hashes[i], Known{kept.back().name, kept.back().T_world_camera,
                                      kept.back().rgb.data()});
    }
    views = std::move(kept);
  }

 private:
  struct Known {
    std::string name;
    core::CameraPose T_world_camera;
    const core::Rgb8* pixels;  ///< As many as every view has.
  };

  [[nodiscard]] const Known* find(std::uint64_t hash,
                                  const core::Image<core::Rgb8>& rgb) const {
    const auto [first, last] = known_.equal_range(hash);
    for (auto it = first; it != last; ++it) {
      if (std::equal(rgb.pixels().begin(), rgb.pixels().end(), it->second.pixels)) {
        return &it->second;
      }
    }
    return nullptr;
  }

  std::vector<std::string>& warnings_;
  std::multimap<std::uint64_t, Known> known_;
};

}  // namespace

TrainingSet load_training_set(
    const RgbdSequence& recording, const MaskSet* masks, const TrainingSetOptions& options,
    const std::function<void(std::int64_t done, std::int64_t total)>& progress) {
  SEGSIM_CHECK(options.frame_step >= 1 && options.shrink >= 1,
               std::to_string(options.frame_step) + ", " + std::to_string(options.shrink));
  const FrameSplit split =
      split_frames(recording.frame_count(), options.frame_step, options.held_out_every);
  if (split.used.empty()) {
    throw core::InputError::expected(
        recording.name(), "frames to train on",
        std::to_string(recording.frame_count()) + " frames, all held out");
  }
  TrainingSet set;
  const core::CameraIntrinsics& recorded = recording.intrinsics();
  if (options.shrink > std::min(recorded.width_px, recorded.height_px)) {
    throw core::InputError::expected(
        recording.name(), "images of at least " + std::to_string(options.shrink) + " pixels",
        std::to_string(recorded.width_px) + " x " + std::to_string(recorded.height_px));
  }
  set.intrinsics = shrunk(recorded, options.shrink);
  if (options.labels)
    set.classes = masks != nullptr ? masks->info().classes : recording.classes();
  set.has_true_labels = options.labels && recording.has_masks();
  const std::size_t total = split.used.size() + split.held_out.size();
  const auto report = [&](std::size_t done) {
    if (progress) progress(static_cast<std::int64_t>(done), static_cast<std::int64_t>(total));
  };
  load_all(
      split.used, set.training,
      [&](std::size_t i) { return load_view(recording, masks, i, options, options.labels); },
      report);
  load_all(
      split.held_out, set.held_out,
      [&](std::size_t i) {
        return load_view(recording, nullptr, i, options, set.has_true_labels);
      },
      [&](std::size_t done) { report(split.used.size() + done); });
  Duplicates duplicates(set.warnings);
  duplicates.remove(set.held_out);
  duplicates.remove(set.training);
  if (set.training.empty()) {
    throw core::InputError::expected(recording.name(), "frames to train on",
                                     "only repetitions of held-out ones");
  }
  return set;
}

}  // namespace segsim::reconstruction
