#pragma once

/// @file
/// Messages of known types in MCAP files, as rosbag2 stores them.

#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "ros/cdr.h"
#include "ros/mcap/mcap_format.h"
#include "ros/mcap/mcap_reader.h"
#include "ros/mcap/mcap_writer.h"
#include "ros/type_description.h"

namespace segsim::ros::mcap {

/// How a publisher offers a topic: what `ros2 bag play` publishes it with.
struct OfferedQos {
  bool reliable = true;
  bool transient_local = false;  ///< Who subscribes late gets the last messages, too.
  int depth = 10;                ///< Of the history.
};

/// As rosbag2 writes them into "offered_qos_profiles" (YAML; numbers are those of rmw's
/// enumerations, which every release reads).
[[nodiscard]] std::string qos_text(const OfferedQos& qos);

/// Schema, encoding and metadata of a topic of ROS 2.
[[nodiscard]] Channel ros2_channel(const std::string& topic, const TypeClosure& type,
                                   const OfferedQos& qos);

/// One topic of a file that is written.
template <Message M>
class TopicWriter {
 public:
  /// @param writer  Must outlive it.
  TopicWriter(Writer& writer, const std::string& topic, const OfferedQos& qos = {})
      : writer_(writer),
        channel_(writer.add_channel(ros2_channel(topic, describe<M>(), qos))) {}

  void write(std::uint64_t time_ns, const M& message) {
    encode_cdr(message, bytes_);
    writer_.write(channel_, time_ns, time_ns, bytes_);
  }

 private:
  Writer& writer_;
  std::uint16_t channel_;
  std::vector<std::byte> bytes_;
};

namespace internal {
/// @throws core::InputError if the message is of another type or encoding.
void check_type(const StoredMessage& message, const std::string& name);
}  // namespace internal

/// @throws core::InputError if the message is not what its channel says, or no `M`.
template <Message M>
[[nodiscard]] M decode(const StoredMessage& message) {
  internal::check_type(message, full_name(M::kType));
  return decode_cdr<M>(message.data, message.place());
}

}  // namespace segsim::ros::mcap
