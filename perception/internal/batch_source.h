#pragma once

/// @file
/// Training batches: images letterboxed once and kept in memory as bytes, augmented anew each
/// time. Everything drawn for a step is keyed by (seed, step), so a resumed run sees the same
/// batches.

#include <cstdint>
#include <vector>

#include "perception/dataset.h"
#include "perception/internal/augmentation.h"

namespace segsim::perception {

struct BatchOptions {
  int input_px = 256;
  int batch = 8;
  double mix_share = 0.0;  ///< Of a batch from the second data set, rounded to whole images.
  bool augment = true;
  Augmentation augmentation;
  std::int64_t mosaic_batches = 0;  ///< Those before this one may have mosaics.
  std::uint64_t seed = 1;
};

/// Images of a batch that come from the second data set.
/// @throws core::InputError if the share rounds to none or to the whole batch.
[[nodiscard]] int mixed_images(double share, int batch);

struct Batch {
  std::vector<float> pixels;  ///< [batch, 3, input_px, input_px], RGB in [0, 1].
  std::vector<std::vector<LabeledBox>> truth;  ///< Boxes in pixels of the square.
};

class BatchSource {
 public:
  /// Loads all images. Both data sets have the detector's classes; `mix` may be nullptr.
  /// @throws core::InputError if an image is missing or has another size than its entry, or as
  ///         mixed_images() does.
  BatchSource(const CocoDataset& main, const CocoDataset* mix, const BatchOptions& options);

  /// The batch of this number; each data set is passed through in shuffled epochs.
  void make(std::int64_t step, Batch& batch) const;

 private:
  [[nodiscard]] static std::vector<Sample> load(const CocoDataset& dataset, int input_px);
  [[nodiscard]] const Sample& draw(const std::vector<Sample>& samples, const char* name,
                                   std::int64_t position) const;
  /// @param others  Where the other pictures of a mosaic come from.
  void augment(const Sample& sample, const std::vector<Sample>& others, std::uint64_t key,
               bool may_mosaic, float* pixels, std::vector<LabeledBox>& truth) const;
  [[nodiscard]] Sample mosaic(const Sample& first, const std::vector<Sample>& others,
                              core::RandomStream& random) const;

  BatchOptions options_;
  std::vector<Sample> main_, mix_;
  int mix_count_ = 0;  ///< Images of a batch that come from mix_.
};

}  // namespace segsim::perception
