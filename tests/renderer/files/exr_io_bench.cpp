// What a recorded frame costs: compressions by time and size, and what the caller of a
// FrameWriter pays. The frame is a view of the standard room.

#include <benchmark/benchmark.h>

#include <filesystem>
#include <memory>

#include <unistd.h>

#include "renderer/cpu_renderer.h"
#include "renderer/files/exr_io.h"
#include "renderer/files/frame_writer.h"
#include "renderer/scene/room_scene.h"

namespace segsim::renderer {
namespace {

namespace fs = std::filesystem;

/// A file name of this process in the system's folder for such.
class TemporaryFile {
 public:
  TemporaryFile()
      : path_(fs::temp_directory_path() /
              ("exr_io_bench" + std::to_string(getpid()) + ".exr")) {}
  ~TemporaryFile() {
    std::error_code ignored;
    fs::remove(path_, ignored);
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

core::Frame room_view(int width_px, int height_px, core::Channels channels) {
  RoomSceneOptions options;
  options.surfel_count = 200'000;
  options.features = core::has(channels, core::Channels::kFeatures);
  const auto room = std::make_shared<const SurfelCloud>(make_room_scene(options));
  return make_cpu_renderer(room, {})->render(room_camera_ring(8)[1],
                                             room_camera(width_px, height_px), channels);
}

const core::Frame& view(bool large) {
  static const core::Frame kSmall = room_view(320, 240, core::Channels::kAll);
  static const core::Frame kLarge = room_view(640, 480, core::Channels::kAll);
  return large ? kLarge : kSmall;
}

/// Arguments: compression, zip level, single part, large.
void write_frame(benchmark::State& loop) {
  const TemporaryFile file;
  ExrOptions options;
  options.compression = static_cast<ExrCompression>(loop.range(0));
  options.zip_level = static_cast<int>(loop.range(1));
  options.layout = loop.range(2) != 0 ? ExrLayout::kSinglePart : ExrLayout::kMultiPart;
  const core::Frame& frame = view(loop.range(3) != 0);
  for (auto _ : loop) write_frame_exr(file.path(), frame, {}, options);
  loop.counters["KiB"] = static_cast<double>(fs::file_size(file.path())) / 1024.0;
}
BENCHMARK(write_frame)
    ->Name("write")
    ->ArgNames({"compression", "level", "single", "large"})
    ->ArgsProduct({{0, 1, 4}, {1}, {0}, {0, 1}})
    ->ArgsProduct({{2, 3}, {1, 4, 6, 9}, {0}, {0, 1}})
    ->Args({3, 1, 1, 1})
    ->Unit(benchmark::kMillisecond);

void read_frame(benchmark::State& loop) {
  const TemporaryFile file;
  ExrOptions options;
  options.compression = static_cast<ExrCompression>(loop.range(0));
  write_frame_exr(file.path(), view(true), {}, options);
  for (auto _ : loop) benchmark::DoNotOptimize(read_frame_exr(file.path()));
}
BENCHMARK(read_frame)->Name("read")->DenseRange(0, 4)->Unit(benchmark::kMillisecond);

/// A frame with features, 48 channels more.
void write_features(benchmark::State& loop) {
  static const core::Frame kFrame =
      room_view(320, 240, core::Channels::kAll | core::Channels::kFeatures);
  const TemporaryFile file;
  for (auto _ : loop) write_frame_exr(file.path(), kFrame);
  loop.counters["KiB"] = static_cast<double>(fs::file_size(file.path())) / 1024.0;
}
BENCHMARK(write_features)->Name("write_features")->Unit(benchmark::kMillisecond);

/// What the control loop pays while the queue has room.
void push_frame(benchmark::State& loop) {
  FrameWriterOptions options;
  options.write = [](const fs::path&, const core::Frame&, const FrameInfo&) {};
  FrameWriter writer(options);
  const core::Frame& frame = view(loop.range(0) != 0);
  for (auto _ : loop) writer.push("unused", frame);
  writer.close();
}
BENCHMARK(push_frame)->Name("push")->DenseRange(0, 1)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace segsim::renderer
