#include <algorithm>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "core/check.h"
#include "reconstruction/rasterizer/differentiable_rasterizer.h"
#include "reconstruction/rasterizer/internal/pair_order.h"
#include "reconstruction/rasterizer/internal/pixel_weights.h"
#include "reconstruction/rasterizer/internal/rasterizer_checks.h"
#include "reconstruction/rasterizer/internal/tile_images.h"
#include "reconstruction/rasterizer/internal/training_tile.h"
#include "reconstruction/rasterizer/internal/view_surfels.h"
#include "reconstruction/rasterizer/internal/weight_losses.h"
#include "reconstruction/rasterizer/surfel_activation.h"
#include "renderer/raster/tile_binning.h"
#include "renderer/scene/projection_camera.h"

namespace segsim::reconstruction {
namespace {

constexpr std::size_t kSurfelsPerTask = 1024;
/// Of a tile.
constexpr std::size_t kCells = internal::kCellsAcross * internal::kCellsAcross;

template <class Real>
class CpuRasterizer final : public DifferentiableRasterizer<Real> {
 public:
  explicit CpuRasterizer(const DifferentiableRasterizerOptions& options)
      : workers_(options.threads) {}

  void forward(const SurfelParameters<Real>& surfels, const core::CameraIntrinsics& camera,
               const core::CameraPose& T_world_camera, const TrainingImages<Real>& images,
               Real* max_weight) override {
    internal::check_view(surfels, camera, images);
    camera_ = {renderer::internal::projection_camera<double>(T_world_camera, camera),
               renderer::internal::projection_camera<float>(T_world_camera, camera),
               camera.width_px, camera.height_px};
    surfel_count_ = surfels.count;
    weight_losses_.clear();
    if (max_weight != nullptr) std::fill_n(max_weight, surfels.count, Real(0));

    bins_.begin(camera.width_px, camera.height_px, workers_.thread_count());
    bins_.open_slab();
    view_.project(surfels, camera_, workers_, bins_);
    bins_.close_slab();
    if (records_.size() < bins_.tile_count()) records_.resize(bins_.tile_count());
    if (cells_.size() < bins_.tile_count()) cells_.resize(bins_.tile_count());
    workers_.for_each(bins_.tile_count(), [&](std::size_t tile) {
      bins_.collect(tile);
      bins_.extend_list(tile, std::numeric_limits<float>::infinity(), nullptr);
      const internal::TileView<Real> view = view_of(tile);
      cells_[tile].resize(view.list.size());
      internal::begin_record(view, camera_, records_[tile]);
      internal::forward_tile(view, records_[tile], cells_[tile].data(), max_weight);
      internal::write_images(view, records_[tile], images);
    });
  }

  void backward(const SurfelParameters<Real>& surfels, const TrainingImages<const Real>& loss,
                const SurfelGradients<Real>& gradients) override {
    internal::check_derivatives(surfels, loss, gradients, surfel_count_, camera_.width_px,
                                camera_.height_px);
    number_pairs();
    workers_.for_each(bins_.tile_count(), [&](std::size_t tile) {
      if (first_pair_[tile + 1] == first_pair_[tile]) return;
      internal::TileLoss<Real> tile_loss;
      const internal::TileView<Real> view = view_of(tile);
      internal::read_loss(view, loss, tile_loss);
      internal::TileWeightLoss<Real> weight_loss;
      const bool weighs = weight_losses_.read(tile, view, cells_[tile], weight_loss);
      internal::backward_tile(view, records_[tile], cells_[tile].data(), tile_loss,
                              weighs ? &weight_loss : nullptr,
                              pair_gradients_.data() + first_pair_[tile]);
    });
    weight_losses_.clear();
    const auto count = static_cast<std::size_t>(surfels.count);
    const renderer::ProjectionCamera<Real> camera = internal::camera_as<Real>(camera_.exact);
    workers_.for_each((count + kSurfelsPerTask - 1) / kSurfelsPerTask, [&](std::size_t task) {
      const std::size_t first = task * kSurfelsPerTask;
      for (std::size_t i = first; i < std::min(count, first + kSurfelsPerTask); ++i) {
        write_surfel(surfels, i, camera, gradients);
      }
    });
  }

  void add_weight_loss(std::span<const std::int32_t> pixels, const PixelWeights& weights,
                       const float* by_weight) override {
    check_drawn();
    SEGSIM_CHECK(weights.pixels == static_cast<std::int64_t>(pixels.size()), "rows");
    for (std::size_t row = 0; row < pixels.size(); ++row) {
      const Place place = place_of(pixels[row]);
      const auto begin = weights.row_start[row], end = weights.row_start[row + 1];
      weight_losses_.add(
          place.cell / kCells, place.cell % kCells * internal::kCellSize + place.in_cell,
          {weights.surfel + begin, weights.weight + begin, by_weight + begin, end - begin});
    }
  }

  [[nodiscard]] PixelWeights weights(const std::int32_t* pixels, std::int64_t count,
                                     int max_per_pixel) override {
    check_drawn();
    SEGSIM_CHECK(count >= 0 && (count == 0 || pixels != nullptr), "no pixels");
    SEGSIM_CHECK(max_per_pixel >= 0, std::to_string(max_per_pixel) + " weights a pixel");
    const std::int64_t area = std::int64_t{camera_.width_px} * camera_.height_px;
    for (std::int64_t p = 0; p < count; ++p) {
      SEGSIM_CHECK(0 <= pixels[p] && pixels[p] < area,
                   "pixel " + std::to_string(pixels[p]) + " of " + std::to_string(area));
    }
    return weights_.collect(
        std::span(pixels, static_cast<std::size_t>(count)), max_per_pixel, workers_,
        bins_.tile_count() * kCells, [&](std::int32_t pixel) { return place_of(pixel).cell; },
        [&] { return CellReader(*this); });
  }

 private:
  void check_drawn() const { SEGSIM_CHECK(camera_.width_px > 0, "no forward() yet"); }

  [[nodiscard]] internal::TileView<Real> view_of(std::size_t tile) const {
    const auto tiles_x = static_cast<std::size_t>(bins_.tiles_x());
    return {view_.data(), bins_.list(tile),
            static_cast<int>(tile % tiles_x) * renderer::internal::kTileSizePx,
            static_cast<int>(tile / tiles_x) * renderer::internal::kTileSizePx};
  }

  /// Pairs of a tile and a surfel that was blended there, tile by tile.
  void number_pairs() {
    const std::size_t tiles = bins_.tile_count();
    first_pair_.resize(tiles + 1);
    order_.begin(static_cast<std::size_t>(surfel_count_));
    std::uint32_t pairs = 0;
    for (std::size_t tile = 0; tile < tiles; ++tile) {
      first_pair_[tile] = pairs;
      const auto list = bins_.list(tile);
      for (std::size_t i = 0; i < list.size(); ++i) {
        if (cells_[tile][i] == 0) continue;
        order_.count(list[i]);
        ++pairs;
      }
    }
    first_pair_[tiles] = pairs;
    order_.end_count();
    for (std::size_t tile = tiles; tile-- > 0;) {
      const auto list = bins_.list(tile);
      for (std::size_t i = list.size(); i-- > 0;) {
        if (cells_[tile][i] != 0) order_.place(list[i], --pairs);
      }
    }
    if (pair_gradients_.size() < first_pair_[tiles]) {
      pair_gradients_.resize(first_pair_[tiles]);
    }
  }

  void write_surfel(const SurfelParameters<Real>& surfels, std::size_t i,
                    const renderer::ProjectionCamera<Real>& camera,
                    const SurfelGradients<Real>& gradients) const {
    const auto pairs = order_.of(i);
    const auto surfel = static_cast<std::int64_t>(i);
    if (pairs.empty()) {
      write_zero_gradients(surfels, surfel, gradients);
      return;
    }
    LocalGradient<Real> sum = pair_gradients_[pairs[0]];
    for (const std::uint32_t pair : pairs.subspan(1)) add(pair_gradients_[pair], sum);
    write_gradients(surfels, surfel, camera, camera_.width_px, camera_.height_px, sum,
                    gradients);
  }

  /// Where a pixel of the image is kept.
  struct Place {
    std::size_t cell;  ///< Of all tiles.
    std::size_t in_cell;
  };
  [[nodiscard]] Place place_of(std::int32_t pixel) const {
    constexpr int kTile = renderer::internal::kTileSizePx;
    const int x = pixel % camera_.width_px, y = pixel / camera_.width_px;
    const std::size_t tile = static_cast<std::size_t>(y / kTile) * bins_.tiles_x() + x / kTile;
    const auto place = static_cast<std::size_t>(internal::place_in_tile(x % kTile, y % kTile));
    return {tile * kCells + place / internal::kCellSize, place % internal::kCellSize};
  }

  /// Weights of pixels; neighbours in a cell share the work.
  class CellReader {
   public:
    explicit CellReader(const CpuRasterizer& owner) : owner_(owner) {}

    void operator()(std::int32_t pixel, std::vector<internal::SurfelWeight>& row) {
      const Place place = owner_.place_of(pixel);
      const std::size_t tile = place.cell / kCells;
      const internal::TileView<Real> view = owner_.view_of(tile);
      if (place.cell != cell_) {
        cell_ = place.cell;
        internal::weigh_cell(view, owner_.records_[tile], owner_.cells_[tile].data(),
                             static_cast<int>(cell_ % kCells), weights_);
      }
      for (std::size_t k = 0; k < weights_.entries.size(); ++k) {
        const auto weight = static_cast<float>(weights_.weights[k][place.in_cell]);
        if (weight == 0.0F) continue;
        row.push_back({static_cast<std::int32_t>(view.list[weights_.entries[k]]), weight});
      }
    }

   private:
    const CpuRasterizer& owner_;
    std::size_t cell_ = std::numeric_limits<std::size_t>::max();
    internal::CellWeights<Real> weights_;
  };

  renderer::internal::Workers workers_;
  internal::ViewCamera camera_{};
  std::int64_t surfel_count_ = 0;
  internal::ViewSurfels<Real> view_;
  renderer::internal::TileBins bins_;
  std::vector<internal::TileRecord<Real>> records_;
  std::vector<std::vector<std::uint16_t>> cells_;  ///< Of each list entry: where it counts.
  std::vector<std::uint32_t> first_pair_;          ///< Of each tile.
  internal::PairOrder order_;
  std::vector<LocalGradient<Real>> pair_gradients_;
  internal::WeightRows weights_;
  internal::WeightLosses<Real> weight_losses_;
};

}  // namespace

template <class Real>
std::unique_ptr<DifferentiableRasterizer<Real>> make_cpu_rasterizer(
    const DifferentiableRasterizerOptions& options) {
  SEGSIM_CHECK(options.threads >= 0, std::to_string(options.threads) + " threads");
  return std::make_unique<CpuRasterizer<Real>>(options);
}

template std::unique_ptr<DifferentiableRasterizer<float>> make_cpu_rasterizer(
    const DifferentiableRasterizerOptions&);
template std::unique_ptr<DifferentiableRasterizer<double>> make_cpu_rasterizer(
    const DifferentiableRasterizerOptions&);

}  // namespace segsim::reconstruction
