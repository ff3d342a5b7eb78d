#include "perception/training/internal/batch_source.h"

#include <array>
#include <cmath>
#include <numeric>

#include "core/error.h"
#include "core/random.h"
#include "perception/data/image_file.h"
#include "perception/data/letterbox.h"

namespace segsim::perception {

int mixed_images(double share, int batch) {
  const int count = static_cast<int>(std::lround(share * batch));
  if (count < 1 || count >= batch) {
    throw core::InputError::expected("training: mix_share",
                                     "a share that is at least one image of a batch of " +
                                         std::to_string(batch) + " and leaves one",
                                     std::to_string(share));
  }
  return count;
}

SampleStore::SampleStore(CocoDataset dataset, int input_px, std::int64_t& cache_bytes)
    : dataset_(std::move(dataset)), input_px_(input_px) {
  for (std::size_t i = 0; i < size(); ++i) {
    Sample sample = load(i);
    const auto bytes = static_cast<std::int64_t>(sample.square.size() * sizeof(core::Rgb8));
    if (kept_.size() < i || bytes > cache_bytes) continue;  // Only checked.
    cache_bytes -= bytes;
    kept_.push_back(std::move(sample));
  }
}

const Sample& SampleStore::get(std::size_t index, Sample& scratch) const {
  if (index < kept_.size()) return kept_[index];
  scratch = load(index);
  return scratch;
}

Sample SampleStore::load(std::size_t index) const {
  const LabeledImage& entry = dataset_.images[index];
  const auto file = dataset_.image_file(entry);
  const auto image = read_image(file);
  if (image.width_px() != entry.width_px || image.height_px() != entry.height_px) {
    throw core::InputError::expected(
        file.string(),
        std::to_string(entry.width_px) + " x " + std::to_string(entry.height_px),
        std::to_string(image.width_px()) + " x " + std::to_string(image.height_px()));
  }
  const Letterbox fit = Letterbox::fit(entry.width_px, entry.height_px, input_px_);
  Sample sample{letterbox(image, fit), entry.boxes,
                fit.to_square({0.0F, 0.0F, static_cast<float>(entry.width_px),
                               static_cast<float>(entry.height_px)})};
  for (LabeledBox& box : sample.boxes) box.box = fit.to_square(box.box);
  return sample;
}

BatchSource::BatchSource(const CocoDataset& main, const CocoDataset* mix,
                         const BatchOptions& options)
    : options_(options) {
  std::int64_t cache_bytes = options.cache_bytes;
  if (mix != nullptr) mix_count_ = mixed_images(options.mix_share, options.batch);
  main_ = SampleStore(main, options.input_px, cache_bytes);
  if (mix != nullptr) mix_ = SampleStore(*mix, options.input_px, cache_bytes);
}

const Sample& BatchSource::draw(const SampleStore& samples, const char* name,
                                std::int64_t position, Sample& scratch) const {
  const auto count = static_cast<std::int64_t>(samples.size());
  // The place in this epoch's shuffle, found by repeating it (Fisher-Yates): cheap beside a
  // step.
  std::vector<std::uint32_t> order(samples.size());
  std::iota(order.begin(), order.end(), 0U);
  core::RandomStream random(options_.seed, name, static_cast<std::uint64_t>(position / count));
  const std::int64_t wanted = position % count;
  for (std::int64_t i = 0; i <= wanted; ++i) {
    const auto j = i + random.index(static_cast<std::uint32_t>(count - i));
    std::swap(order[static_cast<std::size_t>(i)], order[static_cast<std::size_t>(j)]);
  }
  return samples.get(order[static_cast<std::size_t>(wanted)], scratch);
}

Sample BatchSource::mosaic(const Sample& first, const SampleStore& others,
                           core::RandomStream& random) const {
  std::array<const Sample*, 4> four{&first};
  std::array<Sample, 4> scratch;
  for (std::size_t i = 1; i < four.size(); ++i) {
    four[i] = &others.get(random.index(static_cast<std::uint32_t>(others.size())), scratch[i]);
  }
  const auto centre = [&] {
    return static_cast<int>(random.uniform(0.5, 1.5) * options_.input_px);
  };
  const int x_px = centre(), y_px = centre();
  return compose_mosaic(four, x_px, y_px, options_.augmentation.min_kept_share);
}

void BatchSource::augment(const Sample& sample, const SampleStore& others, std::uint64_t key,
                          bool may_mosaic, float* pixels,
                          std::vector<LabeledBox>& truth) const {
  if (!options_.augment) {
    Colour{}.write_planes(sample.square, pixels);
    truth = sample.boxes;
    return;
  }
  const Augmentation& ranges = options_.augmentation;
  core::RandomStream random(options_.seed, "augmentation", key);
  core::RandomStream random_mosaic(options_.seed, "mosaic", key);
  Sample four;
  const Sample* source = &sample;
  if (may_mosaic && random_mosaic.chance(ranges.mosaic)) {
    four = mosaic(sample, others, random_mosaic);
    source = &four;
  }
  const Warp warp = draw_warp(random, ranges, source->square.width_px(), options_.input_px);
  const Colour colour = ranges.tint ? draw_colour(random) : Colour{};
  core::Image<core::Rgb8> image = warp.apply(source->square);
  if (ranges.hue > 0.0 || ranges.saturation > 0.0 || ranges.value > 0.0) {
    const auto factor = [&](double range) { return 1.0 + random.uniform(-range, range); };
    const double hue = factor(ranges.hue), saturation = factor(ranges.saturation);
    scale_hsv(image, hue, saturation, factor(ranges.value));
  }
  colour.write_planes(image, pixels);
  truth = warp_boxes(source->boxes, warp, ranges.min_kept_share);
}

void BatchSource::make(std::int64_t step, Batch& batch) const {
  const std::size_t image_floats = 3 * static_cast<std::size_t>(options_.input_px) *
                                   static_cast<std::size_t>(options_.input_px);
  batch.pixels.resize(image_floats * static_cast<std::size_t>(options_.batch));
  batch.truth.resize(static_cast<std::size_t>(options_.batch));
  const int main_count = options_.batch - mix_count_;
  for (int slot = 0; slot < options_.batch; ++slot) {
    const bool from_main = slot < main_count;
    Sample scratch;
    const Sample& sample =
        from_main ? draw(main_, "epoch", step * main_count + slot, scratch)
                  : draw(mix_, "mix_epoch", step * mix_count_ + (slot - main_count), scratch);
    const auto i = static_cast<std::size_t>(slot);
    augment(sample, from_main ? main_ : mix_,
            static_cast<std::uint64_t>(step * options_.batch + slot),
            step < options_.mosaic_batches, batch.pixels.data() + i * image_floats,
            batch.truth[i]);
  }
}

}  // namespace segsim::perception
