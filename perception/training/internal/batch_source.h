#pragma once

/// @file
/// Training batches: images letterboxed once and kept in memory as bytes, as many as fit a
/// limit (others are read each time), augmented anew each time. Everything drawn for a step is
/// keyed by (seed, step), so a resumed run sees the same batches.

#include <cstdint>
#include <vector>

#include "perception/data/dataset.h"
#include "perception/training/internal/augmentation.h"
#include "perception/training/internal/batch.h"

namespace segsim::perception {

struct BatchOptions {
  int input_px = 256;
  int batch = 8;
  double mix_share = 0.0;  ///< Of a batch from the second data set, rounded to whole images.
  bool augment = true;
  Augmentation augmentation;
  std::int64_t mosaic_batches = 0;  ///< Those before this one may have mosaics.
  std::uint64_t seed = 1;
  std::int64_t cache_bytes = std::int64_t{2} << 30;  ///< Of both data sets' images.
};

/// The letterboxed images of a data set. Batches do not depend on how many are in memory.
class SampleStore {
 public:
  SampleStore() = default;
  /// Reads every image once. @param cache_bytes  What is left; reduced by what is kept.
  /// @throws core::InputError if an image is missing or has another size than its entry.
  SampleStore(CocoDataset dataset, int input_px, std::int64_t& cache_bytes);
  [[nodiscard]] std::size_t size() const { return dataset_.images.size(); }
  /// @param scratch  Where an image goes that is not in memory.
  [[nodiscard]] const Sample& get(std::size_t index, Sample& scratch) const;

 private:
  [[nodiscard]] Sample load(std::size_t index) const;
  CocoDataset dataset_;
  int input_px_ = 0;
  std::vector<Sample> kept_;  ///< The first of the data set.
};

/// Images of a batch that come from the second data set.
/// @throws core::InputError if the share rounds to none or to the whole batch.
[[nodiscard]] int mixed_images(double share, int batch);

class BatchSource {
 public:
  /// Reads all images. Both data sets have the detector's classes; `mix` may be nullptr.
  /// @throws core::InputError if an image is missing or has another size than its entry, or as
  ///         mixed_images() does.
  BatchSource(const CocoDataset& main, const CocoDataset* mix, const BatchOptions& options);

  /// The batch of this number; each data set is passed through in shuffled epochs.
  void make(std::int64_t step, Batch& batch) const;

 private:
  [[nodiscard]] const Sample& draw(const SampleStore& samples, const char* name,
                                   std::int64_t position, Sample& scratch) const;
  /// @param others  Where the other pictures of a mosaic come from.
  void augment(const Sample& sample, const SampleStore& others, std::uint64_t key,
               bool may_mosaic, float* pixels, std::vector<LabeledBox>& truth) const;
  [[nodiscard]] Sample mosaic(const Sample& first, const SampleStore& others,
                              core::RandomStream& random) const;

  BatchOptions options_;
  SampleStore main_, mix_;
  int mix_count_ = 0;  ///< Images of a batch that come from mix_.
};

}  // namespace segsim::perception
