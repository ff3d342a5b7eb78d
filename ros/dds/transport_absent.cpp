// Instead of cyclone_transport.cpp in a program without DDS.
#include "core/error.h"
#include "ros/dds/transport.h"

namespace segsim::ros::dds {

std::unique_ptr<Transport> open_transport(const TransportOptions& /*options*/) {
  throw core::InputError::expected(
      "ROS 2", "a build with SEGSIM_DDS=ON, which needs Debian's package cyclonedds-dev",
      "one without");
}

bool has_transport() { return false; }

}  // namespace segsim::ros::dds
