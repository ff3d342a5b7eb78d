#include "ros/dds/transport.h"

#include "core/error.h"
#include "ros/dds/internal/implementations.h"

namespace segsim::ros::dds {

namespace internal {

Topic on_wire(const Topic& of_ros, Distro distro) {
  if (of_ros.name.size() < 2 || of_ros.name.front() != '/') {
    throw core::InputError::expected("topic", "a name that begins with /",
                                     "\"" + of_ros.name + "\"");
  }
  Topic topic = of_ros;
  topic.name = "rt" + of_ros.name;
  if (distro == Distro::kHumble) topic.type_hash.clear();
  return topic;
}

std::string endpoint_user_data(const Topic& topic) {
  return topic.type_hash.empty() ? std::string() : "typehash=" + topic.type_hash + ";";
}

}  // namespace internal

std::unique_ptr<Transport> open_transport(const TransportOptions& options) {
  return options.implementation == Implementation::kFast ? internal::open_fast(options)
                                                         : internal::open_cyclone(options);
}

bool has_transport(Implementation implementation) {
  return implementation == Implementation::kFast ? internal::has_fast()
                                                 : internal::has_cyclone();
}

}  // namespace segsim::ros::dds
