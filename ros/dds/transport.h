#pragma once

/// @file
/// Messages of ROS 2 over DDS: participants that unmodified nodes see as one of theirs
/// (docs/ros2.md). Bytes go in and come out as ros/cdr.h makes them, with their encapsulation.
///
///     topic /clock                     rt/clock
///     type rosgraph_msgs/msg/Clock     rosgraph_msgs::msg::dds_::Clock_
///     participant                      USER_DATA "enclave=/;"
///     endpoint (Iron and later)        USER_DATA "typehash=RIHS01_...;"
///     node                             ros_discovery_info lists its endpoints

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "ros/message_type.h"
#include "ros/type_description.h"

namespace segsim::ros::dds {

struct Qos {
  bool reliable = true;          ///< Else best effort.
  bool transient_local = false;  ///< Who comes late gets the last messages, too.
  int depth = 10;                ///< Of the history, which keeps the last.
};

/// Releases of ROS 2 that differ on the wire.
enum class Distro : std::uint8_t {
  kHumble,  ///< No type hashes; identifiers of endpoints have 24 bytes.
  kJazzy,   ///< And all from Iron on.
};

struct Topic {
  std::string name;       ///< Of ROS: "/clock".
  std::string type_name;  ///< Of DDS.
  std::string type_hash;  ///< "RIHS01_..."; empty: none is told.
  Qos qos;
};

[[nodiscard]] inline std::string dds_type_name(const MessageType& type) {
  return std::string(type.package) + "::msg::dds_::" + std::string(type.name) + "_";
}

template <Message M>
[[nodiscard]] Topic topic_of(const std::string& name, const Qos& qos = {}) {
  return {name, dds_type_name(M::kType), rihs01(describe<M>()), qos};
}

class Writer {
 public:
  virtual ~Writer() = default;
  /// Never waits for a reader: the history drops its oldest message instead.
  /// @return  False if the message was lost all the same.
  virtual bool write(std::span<const std::byte> cdr) = 0;
  /// How many readers there are now.
  [[nodiscard]] virtual int readers() const = 0;
};

class Reader {
 public:
  virtual ~Reader() = default;
  /// The oldest message that was not taken yet. @return  False: there is none.
  virtual bool take(std::vector<std::byte>& cdr) = 0;
  /// How many writers there are now.
  [[nodiscard]] virtual int writers() const = 0;
};

enum class Implementation : std::uint8_t { kCyclone, kFast };

struct TransportOptions {
  int domain = 0;  ///< ROS_DOMAIN_ID, [0, 232].
  Distro distro = Distro::kJazzy;
  std::string node = "segsim";  ///< As `ros2 node list` shows it, in the namespace "/".
  /// Of the implementation, after the environment's. Cyclone DDS: what CYCLONEDDS_URI may
  /// hold; all transports of a process in one domain share the first one's. Fast DDS: XML
  /// profiles with a participant profile "segsim".
  std::string config;
  Implementation implementation = Implementation::kCyclone;
};

/// One participant with one node. Not for several threads at once. Outlives its writers and
/// readers.
class Transport {
 public:
  virtual ~Transport() = default;
  /// @throws core::InputError if the name is none.
  [[nodiscard]] virtual std::unique_ptr<Writer> make_writer(const Topic& topic) = 0;
  [[nodiscard]] virtual std::unique_ptr<Reader> make_reader(const Topic& topic) = 0;
  /// Waits until one of its readers has a message. @return  False if none came in time.
  virtual bool wait(double timeout_s) = 0;
};

/// @throws core::InputError if this program was built without that implementation, or the
/// domain cannot be joined.
[[nodiscard]] std::unique_ptr<Transport> open_transport(const TransportOptions& options);

/// Whether this program was built with it.
[[nodiscard]] bool has_transport(Implementation implementation = Implementation::kCyclone);

}  // namespace segsim::ros::dds
