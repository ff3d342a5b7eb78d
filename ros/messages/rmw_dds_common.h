#pragma once

/// @file
/// How nodes tell which endpoints are theirs.

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "ros/message_type.h"

namespace segsim::ros::rmw_dds_common {

/// @tparam kBytes  16 from ROS 2 Iron on; before, 24.
template <std::size_t kBytes>
struct GidOf {
  static constexpr MessageType kType{"rmw_dds_common", "Gid"};
  std::array<std::uint8_t, kBytes> data{};
  bool operator==(const GidOf&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("data", self.data);
  }
};

template <std::size_t kGidBytes>
struct NodeEntitiesInfoOf {
  static constexpr MessageType kType{"rmw_dds_common", "NodeEntitiesInfo"};
  BoundedString<256> node_namespace;
  BoundedString<256> node_name;
  std::vector<GidOf<kGidBytes>> reader_gid_seq;
  std::vector<GidOf<kGidBytes>> writer_gid_seq;
  bool operator==(const NodeEntitiesInfoOf&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("node_namespace", self.node_namespace);
    visit("node_name", self.node_name);
    visit("reader_gid_seq", self.reader_gid_seq);
    visit("writer_gid_seq", self.writer_gid_seq);
  }
};

template <std::size_t kGidBytes>
struct ParticipantEntitiesInfoOf {
  static constexpr MessageType kType{"rmw_dds_common", "ParticipantEntitiesInfo"};
  GidOf<kGidBytes> gid;
  std::vector<NodeEntitiesInfoOf<kGidBytes>> node_entities_info_seq;
  bool operator==(const ParticipantEntitiesInfoOf&) const = default;

  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("gid", self.gid);
    visit("node_entities_info_seq", self.node_entities_info_seq);
  }
};

using Gid = GidOf<16>;
using NodeEntitiesInfo = NodeEntitiesInfoOf<16>;
using ParticipantEntitiesInfo = ParticipantEntitiesInfoOf<16>;

}  // namespace segsim::ros::rmw_dds_common
