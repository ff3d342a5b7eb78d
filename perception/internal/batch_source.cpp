#include "perception/internal/batch_source.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "core/random.h"
#include "perception/image_file.h"
#include "perception/letterbox.h"

namespace segsim::perception {
namespace {

// Ranges of the augmentation.
constexpr double kMaxShift = 0.15;                    // Of the side.
constexpr double kMinScale = 0.7, kMaxScale = 1.42;   // Log-uniform.
constexpr double kMinGain = 0.7, kMaxGain = 1.4;      // All channels.
constexpr double kMinTint = 0.9, kMaxTint = 1.1;      // Each channel on its own.
constexpr double kMinColour = 0.6, kMaxColour = 1.4;  // Saturation.

/// A box that keeps less than this of its area, or a side shorter than this, is ignored.
constexpr float kMinKeptShare = 0.2F;
constexpr float kMinSide_px = 2.0F;

/// x_out = scale * (x - c) + c + shift, mirrored afterwards if `flip`; c is the square's
/// centre.
struct Warp {
  double scale = 1.0, shift_x_px = 0.0, shift_y_px = 0.0;
  bool flip = false;

  [[nodiscard]] core::BoxPx apply(const core::BoxPx& box, int size_px) const {
    const double c = size_px / 2.0;
    const auto x = [&](float v) { return scale * (v - c) + c + shift_x_px; };
    const auto y = [&](float v) {
      return static_cast<float>(
          std::clamp(scale * (v - c) + c + shift_y_px, 0.0, double(size_px)));
    };
    const auto cut = [&](double v) {
      return static_cast<float>(std::clamp(v, 0.0, double(size_px)));
    };
    if (flip)
      return {cut(size_px - x(box.x1)), y(box.y0), cut(size_px - x(box.x0)), y(box.y1)};
    return {cut(x(box.x0)), y(box.y0), cut(x(box.x1)), y(box.y1)};
  }

  [[nodiscard]] core::Image<core::Rgb8> apply(const core::Image<core::Rgb8>& image) const {
    const int size = image.width_px();
    const double c = size / 2.0;
    // Pixel i has its centre at i + 0.5 here and at i in OpenCV.
    double ax = scale, bx = scale * (0.5 - c) + c + shift_x_px - 0.5;
    const double by = scale * (0.5 - c) + c + shift_y_px - 0.5;
    if (flip) {
      ax = -ax;
      bx = size - 1.0 - bx;
    }
    const cv::Mat matrix = (cv::Mat_<double>(2, 3) << ax, 0.0, bx, 0.0, scale, by);
    const cv::Mat source(size, size, CV_8UC3, const_cast<core::Rgb8*>(image.data()));
    core::Image<core::Rgb8> out(size, size);
    cv::Mat target(size, size, CV_8UC3, out.data());
    cv::warpAffine(source, target, matrix, target.size(), cv::INTER_LINEAR,
                   cv::BORDER_CONSTANT, cv::Scalar::all(kLetterboxGrey));
    return out;
  }
};

Warp draw_warp(core::RandomStream& random, int size_px) {
  Warp warp;
  warp.flip = random.chance(0.5);
  warp.scale = std::exp(random.uniform(std::log(kMinScale), std::log(kMaxScale)));
  warp.shift_x_px = random.uniform(-kMaxShift, kMaxShift) * size_px;
  warp.shift_y_px = random.uniform(-kMaxShift, kMaxShift) * size_px;
  return warp;
}

/// Bytes to planes of [0, 1] with gain, tint and saturation (1 leaves them as they are).
struct Colour {
  std::array<float, 3> gain{1.0F, 1.0F, 1.0F};
  float saturation = 1.0F;

  void write_planes(const core::Image<core::Rgb8>& image, float* pixels) const {
    const std::size_t count = image.size();
    const core::Rgb8* source = image.data();
    float* r = pixels;
    float* g = pixels + count;
    float* b = pixels + 2 * count;
    const float kr = gain[0] / 255.0F, kg = gain[1] / 255.0F, kb = gain[2] / 255.0F;
    for (std::size_t i = 0; i < count; ++i) {
      const float vr = static_cast<float>(source[i].r) * kr;
      const float vg = static_cast<float>(source[i].g) * kg;
      const float vb = static_cast<float>(source[i].b) * kb;
      const float grey = 0.299F * vr + 0.587F * vg + 0.114F * vb;
      r[i] = std::clamp(grey + saturation * (vr - grey), 0.0F, 1.0F);
      g[i] = std::clamp(grey + saturation * (vg - grey), 0.0F, 1.0F);
      b[i] = std::clamp(grey + saturation * (vb - grey), 0.0F, 1.0F);
    }
  }
};

Colour draw_colour(core::RandomStream& random) {
  Colour colour;
  const double gain = std::exp(random.uniform(std::log(kMinGain), std::log(kMaxGain)));
  for (float& channel : colour.gain) {
    channel = static_cast<float>(gain * random.uniform(kMinTint, kMaxTint));
  }
  colour.saturation = static_cast<float>(random.uniform(kMinColour, kMaxColour));
  return colour;
}

}  // namespace

BatchSource::BatchSource(const CocoDataset& main, const CocoDataset* mix,
                         const BatchOptions& options)
    : options_(options), main_(load(main, options.input_px)) {
  if (mix == nullptr) return;
  mix_ = load(*mix, options.input_px);
  mix_count_ = static_cast<int>(std::lround(options.mix_share * options.batch));
}

std::vector<BatchSource::Sample> BatchSource::load(const CocoDataset& dataset, int input_px) {
  std::vector<Sample> samples;
  samples.reserve(dataset.images.size());
  for (const LabeledImage& entry : dataset.images) {
    const auto file = dataset.image_file(entry);
    const auto image = read_image(file);
    if (image.width_px() != entry.width_px || image.height_px() != entry.height_px) {
      throw core::InputError::expected(
          file.string(),
          std::to_string(entry.width_px) + " x " + std::to_string(entry.height_px),
          std::to_string(image.width_px()) + " x " + std::to_string(image.height_px()));
    }
    const Letterbox fit = Letterbox::fit(entry.width_px, entry.height_px, input_px);
    Sample sample{letterbox(image, fit), entry.boxes};
    for (LabeledBox& box : sample.boxes) box.box = fit.to_square(box.box);
    samples.push_back(std::move(sample));
  }
  return samples;
}

const BatchSource::Sample& BatchSource::draw(const std::vector<Sample>& samples,
                                             const char* name, std::int64_t position) const {
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
  return samples[order[static_cast<std::size_t>(wanted)]];
}

void BatchSource::augment(const Sample& sample, std::uint64_t key, float* pixels,
                          std::vector<LabeledBox>& truth) const {
  truth.clear();
  if (!options_.augment) {
    Colour{}.write_planes(sample.square, pixels);
    truth = sample.boxes;
    return;
  }
  core::RandomStream random(options_.seed, "augmentation", key);
  const Warp warp = draw_warp(random, options_.input_px);
  draw_colour(random).write_planes(warp.apply(sample.square), pixels);
  for (LabeledBox box : sample.boxes) {
    const auto scale_2 = static_cast<float>(warp.scale * warp.scale);
    const float full_area = box.box.area_px2() * scale_2;
    box.box = warp.apply(box.box, options_.input_px);
    const float area = box.box.area_px2();
    if (area <= 0.0F) continue;
    box.ignore |= area < kMinKeptShare * full_area || box.box.width_px() < kMinSide_px ||
                  box.box.height_px() < kMinSide_px;
    truth.push_back(box);
  }
}

void BatchSource::make(std::int64_t step, Batch& batch) const {
  const std::size_t image_floats = 3 * static_cast<std::size_t>(options_.input_px) *
                                   static_cast<std::size_t>(options_.input_px);
  batch.pixels.resize(image_floats * static_cast<std::size_t>(options_.batch));
  batch.truth.resize(static_cast<std::size_t>(options_.batch));
  const int main_count = options_.batch - mix_count_;
  for (int slot = 0; slot < options_.batch; ++slot) {
    const bool from_main = slot < main_count;
    const Sample& sample =
        from_main ? draw(main_, "epoch", step * main_count + slot)
                  : draw(mix_, "mix_epoch", step * mix_count_ + (slot - main_count));
    const auto i = static_cast<std::size_t>(slot);
    augment(sample, static_cast<std::uint64_t>(step * options_.batch + slot),
            batch.pixels.data() + i * image_floats, batch.truth[i]);
  }
}

}  // namespace segsim::perception
