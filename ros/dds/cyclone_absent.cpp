// Instead of cyclone_transport.cpp in a program without Cyclone DDS.
#include "core/error.h"
#include "ros/dds/internal/implementations.h"

namespace segsim::ros::dds::internal {

std::unique_ptr<Transport> open_cyclone(const TransportOptions& /*options*/) {
  throw core::InputError::expected(
      "ROS 2", "a build with SEGSIM_DDS=ON, which needs Debian's package cyclonedds-dev",
      "one without");
}

bool has_cyclone() { return false; }

}  // namespace segsim::ros::dds::internal
