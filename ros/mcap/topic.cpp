#include "ros/mcap/topic.h"

#include "core/error.h"

namespace segsim::ros::mcap {

std::string qos_text(const OfferedQos& qos) {
  static const std::string kForever = "    sec: 9223372036\n    nsec: 854775807\n";
  return "- history: 1\n  depth: " + std::to_string(qos.depth) +
         "\n  reliability: " + (qos.reliable ? "1" : "2") +
         "\n  durability: " + (qos.transient_local ? "1" : "2") + "\n  deadline:\n" +
         kForever + "  lifespan:\n" + kForever +
         "  liveliness: 1\n  liveliness_lease_duration:\n" + kForever +
         "  avoid_ros_namespace_conventions: false";
}

Channel ros2_channel(const std::string& topic, const TypeClosure& type,
                     const OfferedQos& qos) {
  return {topic,
          "cdr",
          {{"offered_qos_profiles", qos_text(qos)}, {"topic_type_hash", rihs01(type)}},
          {type.type.full_name(), "ros2msg", ros2msg_text(type)}};
}

void internal::check_type(const StoredMessage& message, const std::string& name) {
  const Channel& channel = *message.channel;
  if (channel.message_encoding != "cdr") {
    throw core::InputError::expected(message.place(), "encoding cdr",
                                     channel.message_encoding);
  }
  // Some writers leave out the "msg".
  std::string short_form = name;
  short_form.erase(short_form.find("/msg"), 4);
  if (channel.schema.name != name && channel.schema.name != short_form) {
    throw core::InputError::expected(message.place(), name, channel.schema.name);
  }
}

}  // namespace segsim::ros::mcap
