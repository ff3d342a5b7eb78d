#pragma once

/// @file
/// What `ros_discovery_info` says of a participant with one node: which endpoints are the
/// node's (rmw_dds_common/msg/ParticipantEntitiesInfo).

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "ros/dds/transport.h"

namespace segsim::ros::dds::internal {

/// GUID of a participant or an endpoint: 12 bytes of the participant, 4 of the entity.
using Guid = std::array<std::uint8_t, 16>;

struct DiscoveryInfo {
  Guid participant{};
  std::string node;
  std::vector<Guid> readers, writers;
};

/// The topic, which has no "rt/" before its name.
[[nodiscard]] Topic discovery_topic(Distro distro);

/// The message with its encapsulation. In Humble, identifiers have 24 bytes, the last 8 of
/// them zero.
[[nodiscard]] std::vector<std::byte> encode(const DiscoveryInfo& info, Distro distro);

}  // namespace segsim::ros::dds::internal
