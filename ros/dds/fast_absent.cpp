// Instead of fast_transport.cpp in a program without Fast DDS.
#include "core/error.h"
#include "ros/dds/internal/implementations.h"

namespace segsim::ros::dds::internal {

std::unique_ptr<Transport> open_fast(const TransportOptions& /*options*/) {
  throw core::InputError::expected(
      "ROS 2", "a build with SEGSIM_FASTDDS=ON, which needs Debian's package libfastrtps-dev",
      "one without");
}

bool has_fast() { return false; }

}  // namespace segsim::ros::dds::internal
