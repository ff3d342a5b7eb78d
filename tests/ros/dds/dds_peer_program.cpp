// A program at the other end of a network, for tests to stop and to kill, and to measure by:
//     ros_dds_peer listen DOMAIN LAST      reads /numbers until the number LAST has come; once
//                                          it has found the writer, it is one of /ready
//     ros_dds_peer measure DOMAIN FRAMES   reads a camera's images until so many pairs have
//                                          come, or none for five seconds; stamps are those of
//                                          the steady clock, and it prints how old images were
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>
#include <vector>

#include "ros/dds/topic_io.h"
#include "ros/messages/sensor_msgs.h"
#include "ros/messages/std_msgs.h"
#include "tests/ros/dds/loopback.h"

using namespace segsim::ros;

namespace {

using ImageReader = dds::TopicReader<sensor_msgs::Image>;

int listen(dds::Transport& transport, const std::string& last) {
  ImageReader reader(transport, "/numbers", {.depth = 1});
  while (reader.writers() == 0) (void)transport.wait(0.02);
  const dds::TopicWriter<std_msgs::Bool> ready(transport, "/ready");
  while (transport.wait(60.0)) {
    while (const auto message = reader.take()) {
      if (message->header.frame_id == last) return 0;
    }
  }
  return 1;
}

double percentile(const std::vector<double>& sorted, double share) {
  if (sorted.empty()) return 0.0;
  const double at = share * static_cast<double>(sorted.size() - 1);
  return sorted[static_cast<std::size_t>(at + 0.5)];
}

int measure(dds::Transport& transport, std::size_t frames) {
  ImageReader colour(transport, "/camera/image_raw", {.depth = 5});
  ImageReader depth(transport, "/camera/depth/image_raw", {.depth = 5});
  std::map<std::pair<std::int32_t, std::uint32_t>, int> parts;  // By stamp.
  std::vector<double> ages_ms;
  double patience_s = 60.0;
  while (ages_ms.size() < frames && transport.wait(patience_s)) {
    patience_s = 5.0;
    for (ImageReader* reader : {&colour, &depth}) {
      while (const auto image = reader->take()) {
        const auto& stamp = image->header.stamp;
        if (++parts[{stamp.sec, stamp.nanosec}] < 2) continue;
        const std::chrono::duration<double> now =
            std::chrono::steady_clock::now().time_since_epoch();
        ages_ms.push_back((now.count() - stamp.sec - 1e-9 * stamp.nanosec) * 1e3);
      }
    }
  }
  std::sort(ages_ms.begin(), ages_ms.end());
  std::printf("frames %zu\nage_p50_ms %.3f\nage_p99_ms %.3f\nage_max_ms %.3f\n",
              ages_ms.size(), percentile(ages_ms, 0.5), percentile(ages_ms, 0.99),
              percentile(ages_ms, 1.0));
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) return 2;
  const auto transport =
      dds::open_transport({.domain = std::atoi(argv[2]), .config = dds::kLoopback});
  if (std::string(argv[1]) == "listen") return listen(*transport, argv[3]);
  if (std::string(argv[1]) == "measure") {
    return measure(*transport, static_cast<std::size_t>(std::atoi(argv[3])));
  }
  return 2;
}
