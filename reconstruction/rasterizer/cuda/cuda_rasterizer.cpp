#include "reconstruction/rasterizer/cuda/cuda_rasterizer.h"

#include <algorithm>
#include <bit>
#include <string>

#include "core/check.h"
#include "reconstruction/rasterizer/cuda/training_data.h"
#include "reconstruction/rasterizer/internal/rasterizer_checks.h"
#include "renderer/cuda/device_memory.h"
#include "renderer/cuda/kernels.h"
#include "renderer/scene/projection_camera.h"
#include "renderer/scene/render_options.h"

namespace segsim::reconstruction {
namespace {

using renderer::cuda::DeviceArray;
using renderer::cuda::throw_on_error;

class CudaRasterizer final : public DifferentiableRasterizer<float> {
 public:
  explicit CudaRasterizer(const CudaRasterizerOptions& options)
      : stream_(options.stream),
        deterministic_(options.deterministic),
        queue_(renderer::cuda::kQueueWords),
        history_(1),
        status_(1),
        training_queue_(cuda::kTrainingQueueWords),
        bad_pixels_(1) {
    host_status_.reserve(1);
    host_counts_.reserve(3);
    renderer::cuda::FrameView& frame = view_.frame;
    // Inference's default: training sees what the robot will see.
    frame.near_m = renderer::RenderOptions{}.near_m;
    frame.bounds = renderer::cuda::BoundsRule::kAccuTile;
    frame.cameras = 1;
    frame.capacity = kFirstCapacity;
    view_.pair_capacity = kFirstPairs;
  }

  ~CudaRasterizer() override { cudaStreamSynchronize(stream_); }

  void forward(const SurfelParameters<float>& surfels, const core::CameraIntrinsics& camera,
               const core::CameraPose& T_world_camera, const TrainingImages<float>& images,
               float* max_weight) override {
    internal::check_view(surfels, camera, images);
    SEGSIM_CHECK(surfels.count < static_cast<std::int64_t>(renderer::cuda::kMaxSurfels),
                 std::to_string(surfels.count) + " surfels");
    drawn_ = false;  // Until the end: memory may run out.
    surfel_count_ = surfels.count;
    renderer::cuda::FrameView& frame = view_.frame;
    frame.width_px = camera.width_px, frame.height_px = camera.height_px;
    frame.tiles_x = (camera.width_px + renderer::cuda::kTilePx - 1) / renderer::cuda::kTilePx;
    frame.tiles_y = (camera.height_px + renderer::cuda::kTilePx - 1) / renderer::cuda::kTilePx;
    view_.camera = renderer::cuda::view_camera(
        renderer::internal::projection_camera<float>(T_world_camera, camera), camera.width_px,
        camera.height_px);
    set_buffers();
    draw(surfels, images, max_weight);
    while (grow_lists()) {
      set_buffers();
      draw(surfels, images, max_weight);
    }
    drawn_ = true;
  }

  void backward(const SurfelParameters<float>& surfels,
                const TrainingImages<const float>& loss,
                const SurfelGradients<float>& gradients) override {
    internal::check_derivatives(surfels, loss, gradients, surfel_count_,
                                drawn_ ? view_.frame.width_px : 0, view_.frame.height_px);
    cuda::launch_backward(view_, loss, visible_count(), stream_);
    cuda::launch_gradients(view_, surfels, visible_count(), gradients, stream_);
  }

  [[nodiscard]] PixelWeights weights(const std::int32_t* pixels, std::int64_t count,
                                     int max_per_pixel) override {
    SEGSIM_CHECK(drawn_, "no forward() yet");
    SEGSIM_CHECK(count >= 0 && count < (std::int64_t{1} << 31U) - 1 &&
                     (count == 0 || pixels != nullptr),
                 "no pixels");
    SEGSIM_CHECK(max_per_pixel >= 0, std::to_string(max_per_pixel) + " weights a pixel");
    const auto rows = static_cast<std::size_t>(count) + 1;
    all_start_.reserve(rows), row_start_.reserve(rows);
    scratch_.reserve(cuda::weight_scan_bytes(count));
    cuda::WeightTable table{};
    table.pixel = pixels, table.pixels = count, table.max_per_pixel = max_per_pixel;
    table.all_start = all_start_.data(), table.row_start = row_start_.data();
    table.bad_pixels = bad_pixels_.data();
    cuda::launch_weight_rows(view_, table, scratch_.data(), scratch_.bytes(), stream_);
    const std::int32_t* sizes = read_sizes(rows - 1);
    SEGSIM_CHECK(sizes[2] == 0, std::to_string(sizes[2]) + " pixels outside the image");
    // Rows of pixels that are few enough for the interface have fewer than 2^31 entries, or
    // the sum turned negative.
    SEGSIM_CHECK(sizes[0] >= 0, "more than 2^31 weights");
    const auto all = static_cast<std::size_t>(sizes[0]);
    const auto kept = static_cast<std::size_t>(sizes[1]);
    surfel_.reserve(kept), weight_.reserve(kept);
    if (max_per_pixel > 0) all_surfel_.reserve(all), all_weight_.reserve(all);
    table.all_surfel = all_surfel_.data(), table.all_weight = all_weight_.data();
    table.surfel = surfel_.data(), table.weight = weight_.data();
    cuda::launch_weight_entries(view_, table, stream_);
    return {count, static_cast<std::int64_t>(kept), row_start_.data(), surfel_.data(),
            weight_.data()};
  }

 private:
  static constexpr std::uint32_t kFirstCapacity = 1024, kFirstPairs = 1U << 20U;
  /// Without room for a part its surfel is binned by one warp, which is slow.
  static constexpr std::size_t kLeastLargeParts = std::size_t{1} << 18U;

  void set_buffers() {
    renderer::cuda::FrameView& frame = view_.frame;
    const auto surfels = static_cast<std::size_t>(surfel_count_);
    const std::size_t tiles =
        static_cast<std::size_t>(frame.tiles_x) * static_cast<std::size_t>(frame.tiles_y);
    const std::size_t pairs = view_.pair_capacity;
    const std::size_t segments = pairs / cuda::kSegment + tiles;
    constexpr std::size_t kTileSums = cuda::kStatePlanes * renderer::cuda::kTilePixels;
    frame.large_capacity = static_cast<std::uint32_t>(std::max(kLeastLargeParts, surfels / 4));
    const auto room = [](auto& array, std::size_t count) {
      array.reserve(count);
      return array.data();
    };
    view_.drawn = room(records_, surfels), view_.pixels = room(surfel_pixels_, surfels);
    view_.visible = room(visible_, surfels);
    view_.sum = room(sum_, surfels * cuda::kSums), view_.reach_sum = room(reach_sum_, surfels);
    view_.list_base = room(list_base_, tiles), view_.queue = training_queue_.data();
    view_.read_count = room(read_count_, cuda::kParts * tiles);
    view_.sorted = room(sorted_, pairs), view_.hits = room(hits_, cuda::kParts * pairs);
    view_.state = room(state_, tiles * kTileSums);
    view_.segment_state = room(segment_state_, segments * kTileSums);
    view_.segment_base = room(segment_base_, tiles), view_.item = room(item_, 4 * segments);
    if (deterministic_) {
      view_.part = room(part_, 4 * pairs * cuda::kSums);
      view_.part_reach = room(part_reach_, 4 * pairs);
    }
    frame.bucket = room(bucket_, tiles * frame.capacity);
    frame.large = room(large_, frame.large_capacity * renderer::cuda::kLargePartBytes);
    frame.count = room(count_, tiles), frame.order = room(order_, tiles);
    frame.bound_m = room(bound_, tiles), frame.redo = room(redo_, tiles);
    frame.queue = queue_.data(), frame.history = history_.data();
    frame.status = status_.data();
  }

  /// Puts a view into the stream and waits until its lists are made.
  void draw(const SurfelParameters<float>& surfels, const TrainingImages<float>& images,
            float* max_weight) {
    clear(training_queue_.data(), cuda::kTrainingQueueWords);
    if (max_weight != nullptr) clear(max_weight, static_cast<std::size_t>(surfels.count));
    renderer::cuda::launch_begin_frame(view_.frame, stream_);
    cuda::launch_project(view_, surfels, stream_);
    renderer::cuda::launch_order_tiles(view_.frame, stream_);
    throw_on_error(
        cudaMemcpyAsync(host_status_.data(), status_.data(),
                        sizeof(renderer::cuda::FrameStatus), cudaMemcpyDeviceToHost, stream_),
        "cudaMemcpyAsync");
    throw_on_error(cudaEventRecord(lists_made_.get(), stream_), "cudaEventRecord");
    // The device need not wait for the host: it draws what there is room for.
    cuda::launch_forward(view_, images, max_weight, stream_);
    throw_on_error(cudaEventSynchronize(lists_made_.get()), "lists of surfels");
  }

  /// @return  True if the last lists did not fit in their buffers.
  bool grow_lists() {
    const renderer::cuda::FrameStatus& status = *host_status_.data();
    const auto enough = [](std::uint64_t wanted) {
      SEGSIM_CHECK(wanted < std::uint64_t{1} << 30U,
                   std::to_string(wanted) + " pairs of a tile and a surfel");
      return static_cast<std::uint32_t>(wanted + wanted / 4);
    };
    bool grown = false;
    if (status.longest_list > view_.frame.capacity) {
      view_.frame.capacity = std::bit_ceil(enough(status.longest_list));
      grown = true;
    }
    if (status.pairs_binned > view_.pair_capacity) {
      view_.pair_capacity = enough(status.pairs_binned);
      grown = true;
    }
    return grown;
  }

  [[nodiscard]] std::uint32_t visible_count() const {
    return static_cast<std::uint32_t>(host_status_.data()->surfels_projected);
  }

  template <class T>
  void clear(T* values, std::size_t count) {
    if (count == 0) return;
    throw_on_error(cudaMemsetAsync(values, 0, count * sizeof(T), stream_), "cudaMemsetAsync");
  }

  /// Entries of all rows, of the rows returned, and bad pixels; waits for them.
  const std::int32_t* read_sizes(std::size_t last_row) {
    const std::int32_t* from[] = {all_start_.data() + last_row, row_start_.data() + last_row,
                                  bad_pixels_.data()};
    for (std::size_t i = 0; i < 3; ++i) {
      throw_on_error(cudaMemcpyAsync(host_counts_.data() + i, from[i], sizeof(std::int32_t),
                                     cudaMemcpyDeviceToHost, stream_),
                     "cudaMemcpyAsync");
    }
    throw_on_error(cudaStreamSynchronize(stream_), "rows of weights");
    return host_counts_.data();
  }

  cudaStream_t stream_;
  bool deterministic_;
  bool drawn_ = false;  ///< Is there a view for backward()?
  std::int64_t surfel_count_ = 0;
  cuda::TrainingView view_{};
  renderer::cuda::Event lists_made_;
  renderer::cuda::PinnedArray<renderer::cuda::FrameStatus> host_status_;
  renderer::cuda::PinnedArray<std::int32_t> host_counts_;

  // The view's lists
  DeviceArray<std::uint32_t> queue_, count_, order_;
  DeviceArray<renderer::cuda::ListKey> bucket_;
  DeviceArray<std::byte> large_;
  DeviceArray<float> bound_;
  DeviceArray<std::uint8_t> redo_;
  DeviceArray<bool> history_;
  DeviceArray<renderer::cuda::FrameStatus> status_;
  // What forward leaves for backward
  DeviceArray<cuda::DrawnRecord> records_;
  DeviceArray<cuda::SurfelPixels> surfel_pixels_;
  DeviceArray<std::uint32_t> visible_, training_queue_, list_base_, read_count_, segment_base_;
  DeviceArray<renderer::cuda::ListKey> sorted_;
  DeviceArray<cuda::HitMask> hits_;
  DeviceArray<cuda::WalkItem> item_;
  DeviceArray<float> state_, segment_state_, sum_, reach_sum_, part_, part_reach_;
  // weights()
  DeviceArray<std::int32_t> all_start_, row_start_, all_surfel_, surfel_, bad_pixels_;
  DeviceArray<float> all_weight_, weight_;
  DeviceArray<std::byte> scratch_;
};

}  // namespace

std::unique_ptr<DifferentiableRasterizer<float>> make_cuda_rasterizer(
    const CudaRasterizerOptions& options) {
  renderer::cuda::check_device();
  return std::make_unique<CudaRasterizer>(options);
}

}  // namespace segsim::reconstruction
