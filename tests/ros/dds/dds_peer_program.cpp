// A program at the other end of a network, for the tests to stop and to kill:
//     ros_dds_peer listen DOMAIN LAST    reads /numbers until the number LAST has come
#include <cstdio>
#include <cstdlib>
#include <string>

#include "ros/dds/topic_io.h"
#include "ros/messages/sensor_msgs.h"
#include "tests/ros/dds/loopback.h"

using namespace segsim::ros;

int main(int argc, char** argv) {
  if (argc != 4 || std::string(argv[1]) != "listen") return 2;
  const auto transport =
      dds::open_transport({.domain = std::atoi(argv[2]), .config = dds::kLoopback});
  dds::TopicReader<sensor_msgs::Image> reader(*transport, "/numbers", {.depth = 1});
  while (transport->wait(60.0)) {
    while (const auto message = reader.take()) {
      if (message->header.frame_id == argv[3]) return 0;
    }
  }
  return 1;
}
