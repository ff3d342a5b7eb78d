#include "renderer/cuda/cuda_renderer.h"

#include <algorithm>
#include <array>
#include <bit>
#include <chrono>
#include <string>
#include <utility>
#include <vector>

#include "core/check.h"
#include "renderer/cuda/device_images.h"
#include "renderer/cuda/device_scene.h"
#include "renderer/cuda/kernels.h"
#include "renderer/scene/projection_camera.h"

namespace segsim::renderer {
namespace {

using core::Channels;
using core::has;
using cuda::DeviceArray;
using cuda::throw_on_error;

class CudaRendererImpl final : public CudaRenderer {
 public:
  CudaRendererImpl(std::shared_ptr<const SurfelCloud> surfels, const RenderOptions& options,
                   const std::shared_ptr<const PanopticField>& field)
      : surfels_(std::move(surfels)),
        options_(options),
        scene_(*surfels_, field.get()),
        cameras_(cuda::kMaxCameras),
        previous_cameras_(cuda::kMaxCameras),
        queue_(cuda::kQueueWords),
        status_(1) {
    DeviceArray<bool> history(cuda::kMaxCameras);
    history_ = std::move(history);
    host_status_.reserve(1);
    // The first frame makes these the previous ones.
    throw_on_error(cudaMemset(cameras_.data(), 0, cameras_.bytes()), "cudaMemset");
    frame_.near_m = options_.near_m;
    frame_.bounds = bounds_of(options_.bounds);
    frame_.median_depth = options_.depth == DepthMode::kMedian;
    frame_.first_hits = options_.top_k_rule == TopKRule::kFirst;
    frame_.top_k = options_.top_k;
    frame_.capacity = kFirstCapacity;
  }

  ~CudaRendererImpl() override { cudaStreamSynchronize(stream_.get()); }

  using core::Renderer::render;
  void render(const core::CameraPose& T_world_camera, const core::CameraIntrinsics& intrinsics,
              Channels channels, core::Frame& frame) override {
    const auto start = std::chrono::steady_clock::now();
    render_batch({&T_world_camera, 1}, intrinsics, channels);
    read_back(0, channels, frame);
    frame.stats = stats();
    frame.stats.render_ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
            .count();
  }

  const core::DeviceFrames& render_batch(std::span<const core::CameraPose> T_world_camera,
                                         const core::CameraIntrinsics& intrinsics,
                                         Channels channels) override {
    internal::check_intrinsics(intrinsics);
    SEGSIM_CHECK(!T_world_camera.empty() && T_world_camera.size() <= cuda::kMaxCameras,
                 std::to_string(T_world_camera.size()) + " cameras");
    wait();
    const Channels drawn =
        has(channels, Channels::kDepthNormal) ? channels | Channels::kDepth : channels;
    set_shape({intrinsics.width_px, intrinsics.height_px,
               static_cast<int>(T_world_camera.size()), drawn});
    intrinsics_ = intrinsics;
    T_world_camera_.assign(T_world_camera.begin(), T_world_camera.end());
    projection_cameras_.clear();
    for (const core::CameraPose& T : T_world_camera) {
      projection_cameras_.push_back(internal::projection_camera<float>(T, intrinsics));
    }
    cuda::launch_store_cameras(projection_cameras_.data(), shape_.cameras, frame_,
                               stream_.get());
    launch();
    pending_ = true;
    return frames_;
  }

  void wait() override {
    if (!pending_) return;
    throw_on_error(cudaStreamSynchronize(stream_.get()), "a frame");
    while (host_status_.data()->longest_list > frame_.capacity) {
      const std::uint32_t longest = host_status_.data()->longest_list;
      frame_.capacity = std::bit_ceil(longest + longest / 4);
      set_buffers();
      launch();
      throw_on_error(cudaStreamSynchronize(stream_.get()), "a frame");
    }
    pending_ = false;
    if (!culling_decided_) decide_culling();
  }

  void read_back(int index, Channels channels, core::Frame& frame) override {
    SEGSIM_CHECK(index >= 0 && index < shape_.cameras, "image " + std::to_string(index));
    wait();
    frame.intrinsics = intrinsics_;
    frame.T_world_camera = T_world_camera_[static_cast<std::size_t>(index)];
    images_.read_back(index, channels, stream_.get(), frame);
  }

  void copy_images(std::span<const DeviceCopy> copies, CUstream_st* stream) override {
    wait();
    for (const DeviceCopy& copy : copies) {
      throw_on_error(
          cudaMemcpyAsync(copy.to, copy.from, copy.bytes, cudaMemcpyDefault, stream),
          "cudaMemcpyAsync");
    }
    throw_on_error(cudaEventRecord(copied_.get(), stream), "cudaEventRecord");
    throw_on_error(cudaStreamWaitEvent(stream_.get(), copied_.get(), 0),
                   "cudaStreamWaitEvent");
  }

  core::RenderStats stats() override {
    wait();
    const cuda::FrameStatus& s = *host_status_.data();
    return {.surfels_projected = s.surfels_projected,
            .pairs_binned = s.pairs_binned,
            .pairs_touched = s.pairs_touched,
            .evaluations = s.evaluations,
            .contributions = s.contributions,
            .feature_fetches = s.feature_fetches};
  }

  std::uint32_t fixed_tiles() override {
    wait();
    return host_status_.data()->fixed_tiles;
  }

  void count_contributions(bool counts) override {
    wait();
    frame_.counts = counts;
    graph_.reset();
  }

  void always_skip_hidden(bool always) override {
    wait();
    always_culls_ = always;
    culling_decided_ = false;
  }

  CudaStageTimes measure_stages() override {
    wait();
    cudaStream_t stream = stream_.get();
    const auto mark = [&](int i) {
      throw_on_error(cudaEventRecord(marks_[static_cast<std::size_t>(i)].get(), stream),
                     "cudaEventRecord");
    };
    mark(0);
    enqueue(mark);
    throw_on_error(cudaStreamSynchronize(stream), "a frame");
    const auto between = [&](std::size_t i) {
      float ms = 0.0F;
      throw_on_error(cudaEventElapsedTime(&ms, marks_[i].get(), marks_[i + 1].get()),
                     "cudaEventElapsedTime");
      return static_cast<double>(ms);
    };
    return {between(0), between(1), between(2), between(3), between(4)};
  }

  void poison_images() override {
    wait();
    images_.poison(stream_.get());
  }

 private:
  static constexpr std::uint32_t kFirstCapacity = 1024;
  /// Without room for a part its surfel is binned by one warp, which is slow.
  static constexpr std::size_t kLeastLargeParts = std::size_t{1} << 18U;
  static constexpr std::size_t kMostLargeParts = std::size_t{1} << 21U;

  static cuda::BoundsRule bounds_of(TileBounds bounds) {
    switch (bounds) {
      case TileBounds::kAabb:
        return cuda::BoundsRule::kAabb;
      case TileBounds::kSnugBox:
        return cuda::BoundsRule::kSnugBox;
      case TileBounds::kPaper:
        return cuda::BoundsRule::kPaper;
      case TileBounds::kAccuTile:
        break;
    }
    return cuda::BoundsRule::kAccuTile;
  }

  void set_shape(const cuda::BatchShape& shape) {
    if (shape == shape_) return;
    graph_.reset();
    const bool same_size = shape.width_px == shape_.width_px &&
                           shape.height_px == shape_.height_px &&
                           shape.cameras == shape_.cameras;
    shape_ = {};
    frame_.width_px = shape.width_px, frame_.height_px = shape.height_px;
    frame_.tiles_x = (shape.width_px + cuda::kTilePx - 1) / cuda::kTilePx;
    frame_.tiles_y = (shape.height_px + cuda::kTilePx - 1) / cuda::kTilePx;
    frame_.cameras = shape.cameras;
    frame_.colours = has(shape.channels, Channels::kRgb);
    frame_.normals = has(shape.channels, Channels::kNormal);
    frame_.labels = has(shape.channels, Channels::kLabels);
    frame_.features = has(shape.channels, Channels::kFeatures);
    frame_.labels_only = shape.channels == Channels::kLabels;
    set_buffers();
    frame_.image = images_.set_shape(shape);
    frames_ = images_.frames(stream_.get());
    if (!same_size || shape.channels != last_channels_) {
      // A frame of labels alone ends its tiles earlier than others.
      throw_on_error(cudaMemsetAsync(history_.data(), 0, history_.bytes(), stream_.get()),
                     "cudaMemsetAsync");
      frame_.culls = false;
      culling_decided_ = false;
    }
    last_channels_ = shape.channels;
    shape_ = shape;
  }

  /// Culling costs a look at all clusters and tiles that must be drawn again. The first frame
  /// of a shape has whole lists, the second tries; it stays if that halves them.
  void decide_culling() {
    const auto pairs = static_cast<double>(host_status_.data()->pairs_binned);
    bool culls = options_.skip_hidden;
    if (frame_.culls && !always_culls_) {
      constexpr double kWorthCulling = 0.5;
      culls = pairs < kWorthCulling * whole_pairs_;
      culling_decided_ = true;
    } else {
      whole_pairs_ = pairs;
      culling_decided_ = !culls || always_culls_;
    }
    if (culls != frame_.culls) graph_.reset();
    frame_.culls = culls;
  }

  void set_buffers() {
    graph_.reset();
    const std::size_t tiles = static_cast<std::size_t>(frame_.tiles_x) *
                              static_cast<std::size_t>(frame_.tiles_y) *
                              static_cast<std::size_t>(frame_.cameras);
    record_.reserve(scene_.padded_surfels() * static_cast<std::size_t>(frame_.cameras));
    bucket_.reserve(tiles * frame_.capacity);
    frame_.large_capacity = static_cast<std::uint32_t>(
        std::clamp(2 * scene_.padded_surfels() * static_cast<std::size_t>(frame_.cameras),
                   kLeastLargeParts, kMostLargeParts));
    large_.reserve(frame_.large_capacity * cuda::kLargePartBytes);
    count_.reserve(tiles), order_.reserve(tiles), redo_list_.reserve(tiles);
    bound_.reserve(tiles), ended_.reserve(tiles), redo_.reserve(tiles);
    frame_.camera = cameras_.data(), frame_.previous_camera = previous_cameras_.data();
    frame_.record = record_.data(), frame_.bucket = bucket_.data();
    frame_.count = count_.data(), frame_.order = order_.data();
    frame_.redo_list = redo_list_.data(), frame_.redo = redo_.data();
    frame_.bound_m = bound_.data(), frame_.ended_m = ended_.data();
    frame_.queue = queue_.data(), frame_.large = large_.data();
    frame_.history = history_.data();
    frame_.status = status_.data();
  }

  /// @param mark  Called with 1 ... 5 after the steps.
  template <class Mark>
  void enqueue(const Mark& mark) {
    cudaStream_t stream = stream_.get();
    cuda::launch_begin_frame(frame_, stream);
    mark(1);
    cuda::launch_project_and_bin(frame_, scene_.view(), false, stream);
    mark(2);
    cuda::launch_order_tiles(frame_, stream);
    mark(3);
    cuda::launch_raster(frame_, scene_.view(), scene_.field(), scene_.features(), false,
                        stream);
    mark(4);
    if (frame_.culls) {
      cuda::launch_project_and_bin(frame_, scene_.view(), true, stream);
      cuda::launch_raster(frame_, scene_.view(), scene_.field(), scene_.features(), true,
                          stream);
    }
    mark(5);
    throw_on_error(cudaMemcpyAsync(host_status_.data(), status_.data(),
                                   sizeof(cuda::FrameStatus), cudaMemcpyDeviceToHost, stream),
                   "cudaMemcpyAsync");
  }

  void launch() {
    if (graph_.empty()) {
      graph_.record(stream_.get(), [&] { enqueue([](int) {}); });
    }
    graph_.launch(stream_.get());
  }

  std::shared_ptr<const SurfelCloud> surfels_;
  RenderOptions options_;
  cuda::Stream stream_;
  cuda::Event copied_;
  cuda::DeviceScene scene_;
  DeviceArray<cuda::ViewCamera> cameras_, previous_cameras_;
  DeviceArray<std::uint32_t> queue_, count_, order_, redo_list_;
  DeviceArray<std::byte> large_;
  DeviceArray<cuda::FrameStatus> status_;
  DeviceArray<bool> history_;
  DeviceArray<cuda::SurfelRecord> record_;
  DeviceArray<cuda::ListKey> bucket_;
  DeviceArray<float> bound_, ended_;
  DeviceArray<std::uint8_t> redo_;
  cuda::DeviceImages images_;
  cuda::PinnedArray<cuda::FrameStatus> host_status_;
  std::array<cuda::Event, 6> marks_;
  cuda::Graph graph_;
  cuda::FrameView frame_{};
  core::DeviceFrames frames_;
  cuda::BatchShape shape_;
  Channels last_channels_ = Channels::kNone;
  core::CameraIntrinsics intrinsics_;
  std::vector<core::CameraPose> T_world_camera_;
  std::vector<ProjectionCamera<float>> projection_cameras_;
  bool pending_ = false;
  bool culling_decided_ = false, always_culls_ = false;
  double whole_pairs_ = 0.0;  ///< In the lists of the first frame of this shape.
};

}  // namespace

std::unique_ptr<CudaRenderer> make_cuda_renderer(std::shared_ptr<const SurfelCloud> surfels,
                                                 RenderOptions options,
                                                 std::shared_ptr<const PanopticField> field) {
  SEGSIM_CHECK(surfels != nullptr, "no scene");
  check_surfels(*surfels);
  check_render_options(options);
  SEGSIM_CHECK(field == nullptr || field->size() == surfels->size(), "field of another scene");
  if (options.compat != Compat::kExact) {
    throw GpuError("GPU: expected compat exact, found a mode of the CPU renderer only");
  }
  if (options.top_k == kAllSurfels) {
    throw GpuError("GPU: expected top-k 1 ... " + std::to_string(kMaxTopK) +
                   ", found all, which only the CPU renderer has");
  }
  if (surfels->size() >= cuda::kMaxSurfels) {
    throw GpuError("GPU: expected fewer than " + std::to_string(cuda::kMaxSurfels) +
                   " surfels, found " + std::to_string(surfels->size()));
  }
  cuda::check_device();
  return std::make_unique<CudaRendererImpl>(std::move(surfels), options, field);
}

}  // namespace segsim::renderer
