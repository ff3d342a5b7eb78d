#pragma once

/// @file
/// How nodes tell which endpoints are theirs.

#include <array>
#include <cstdint>
#include <vector>

#include "ros/message_type.h"

namespace segsim::ros::rmw_dds_common {

/// From ROS 2 Iron on; before, it had 24 bytes.
struct Gid {
  static constexpr MessageType kType{"rmw_dds_common", "Gid"};
  std::array<std::uint8_t, 16> data{};
  bool operator==(const Gid&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("data", self.data);
  }
};

struct NodeEntitiesInfo {
  static constexpr MessageType kType{"rmw_dds_common", "NodeEntitiesInfo"};
  BoundedString<256> node_namespace;
  BoundedString<256> node_name;
  std::vector<Gid> reader_gid_seq;
  std::vector<Gid> writer_gid_seq;
  bool operator==(const NodeEntitiesInfo&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("node_namespace", self.node_namespace);
    visit("node_name", self.node_name);
    visit("reader_gid_seq", self.reader_gid_seq);
    visit("writer_gid_seq", self.writer_gid_seq);
  }
};

struct ParticipantEntitiesInfo {
  static constexpr MessageType kType{"rmw_dds_common", "ParticipantEntitiesInfo"};
  Gid gid;
  std::vector<NodeEntitiesInfo> node_entities_info_seq;
  bool operator==(const ParticipantEntitiesInfo&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("gid", self.gid);
    visit("node_entities_info_seq", self.node_entities_info_seq);
  }
};

}  // namespace segsim::ros::rmw_dds_common
