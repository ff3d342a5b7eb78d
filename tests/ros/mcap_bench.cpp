// How fast recordings are written and read: images of a 640x480 RGB-D camera with noise, as
// the field's recordings have them; the bytes are those of the messages.
#include <fstream>

#include <benchmark/benchmark.h>

#include "core/random.h"
#include "ros/mcap/topic.h"
#include "ros/messages/sensor_msgs.h"
#include "tests/temporary_folder.h"

namespace {

using namespace segsim;
using ros::mcap::Compression;

constexpr int kImages = 40;

ros::sensor_msgs::Image colour_image() {
  ros::sensor_msgs::Image image{{{}, "camera"}, 480, 640, "rgb8", 0, 3 * 640, {}};
  image.data.resize(std::size_t{480} * 640 * 3);
  core::RandomStream random(1, "image");
  for (std::size_t k = 0; k < image.data.size(); ++k) {
    // A smooth picture with two bits of noise.
    image.data[k] = static_cast<std::uint8_t>(k / 7200 + random.index(4));
  }
  return image;
}

ros::sensor_msgs::Image depth_image() {
  ros::sensor_msgs::Image image{{{}, "camera"}, 480, 640, "32FC1", 0, 4 * 640, {}};
  std::vector<float> depth_m(std::size_t{480} * 640);
  core::RandomStream random(2, "depth");
  for (std::size_t k = 0; k < depth_m.size(); ++k) {
    depth_m[k] =
        2.0F + 1e-6F * static_cast<float>(k) + 1e-3F * static_cast<float>(random.index(9));
  }
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(depth_m.data());
  image.data.assign(bytes, bytes + 4 * depth_m.size());
  return image;
}

std::size_t write_images(const std::filesystem::path& file, Compression compression) {
  static const ros::sensor_msgs::Image colour = colour_image(), depth = depth_image();
  std::ofstream out(file, std::ios::binary);
  ros::mcap::Writer writer(out, {.compression = compression});
  ros::mcap::TopicWriter<ros::sensor_msgs::Image> colours(writer, "/camera/image_raw");
  ros::mcap::TopicWriter<ros::sensor_msgs::Image> depths(writer, "/camera/depth/image_raw");
  for (std::uint64_t k = 0; k < kImages; ++k) {
    colours.write(k * 33'000'000, colour);
    depths.write(k * 33'000'000, depth);
  }
  writer.close();
  return kImages * (colour.data.size() + depth.data.size());
}

Compression compression_of(const benchmark::State& state) {
  return static_cast<Compression>(state.range(0));
}

void BM_Write(benchmark::State& state) {
  const tests::TemporaryFolder folder("mcap_bench");
  std::size_t bytes = 0;
  for (auto _ : state) bytes += write_images(folder / "a.mcap", compression_of(state));
  state.SetBytesProcessed(static_cast<std::int64_t>(bytes));
  state.SetLabel(to_string(compression_of(state)));
  if (std::filesystem::file_size(folder / "a.mcap") < 1000)
    state.SkipWithError("nothing written");
}
BENCHMARK(BM_Write)->DenseRange(0, 2)->Unit(benchmark::kMillisecond);

void BM_Read(benchmark::State& state) {
  const tests::TemporaryFolder folder("mcap_bench");
  const std::size_t bytes = write_images(folder / "a.mcap", compression_of(state));
  std::size_t read = 0;
  for (auto _ : state) {
    ros::mcap::Reader reader(folder / "a.mcap");
    reader.read([&](const ros::mcap::StoredMessage& message) { read += message.data.size(); });
  }
  state.SetBytesProcessed(static_cast<std::int64_t>(read));
  state.SetLabel(to_string(compression_of(state)));
  if (read < bytes) state.SkipWithError("not all was read");
}
BENCHMARK(BM_Read)->DenseRange(0, 2)->Unit(benchmark::kMillisecond);

}  // namespace
