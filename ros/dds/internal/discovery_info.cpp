#include "ros/dds/internal/discovery_info.h"

#include <algorithm>

#include "ros/cdr.h"
#include "ros/messages/rmw_dds_common.h"

namespace segsim::ros::dds::internal {
namespace {

/// As rmw_dds_common has them before Iron; of the names above there, which have 16 bytes.
struct HumbleGid {
  static constexpr MessageType kType{"rmw_dds_common", "Gid"};
  std::array<std::uint8_t, 24> data{};
  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("data", self.data);
  }
};

struct HumbleNode {
  static constexpr MessageType kType{"rmw_dds_common", "NodeEntitiesInfo"};
  std::string node_namespace, node_name;
  std::vector<HumbleGid> reader_gid_seq, writer_gid_seq;
  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("node_namespace", self.node_namespace);
    visit("node_name", self.node_name);
    visit("reader_gid_seq", self.reader_gid_seq);
    visit("writer_gid_seq", self.writer_gid_seq);
  }
};

struct HumbleParticipant {
  static constexpr MessageType kType{"rmw_dds_common", "ParticipantEntitiesInfo"};
  HumbleGid gid;
  std::vector<HumbleNode> node_entities_info_seq;
  template <class Self, class Visitor>
  static void visit_fields(Self& self, Visitor&& visit) {
    visit("gid", self.gid);
    visit("node_entities_info_seq", self.node_entities_info_seq);
  }
};

template <class Gid>
Gid gid_of(const Guid& guid) {
  Gid gid;
  std::copy(guid.begin(), guid.end(), gid.data.begin());
  return gid;
}

template <class Participant, class Node, class Gid>
std::vector<std::byte> encode_as(const DiscoveryInfo& info) {
  Participant participant;
  participant.gid = gid_of<Gid>(info.participant);
  Node& node = participant.node_entities_info_seq.emplace_back();
  node.node_namespace.assign("/");
  node.node_name.assign(info.node);
  for (const Guid& guid : info.readers) node.reader_gid_seq.push_back(gid_of<Gid>(guid));
  for (const Guid& guid : info.writers) node.writer_gid_seq.push_back(gid_of<Gid>(guid));
  return encode_cdr(participant);
}

}  // namespace

Topic discovery_topic(Distro distro) {
  namespace common = rmw_dds_common;
  Topic topic = topic_of<common::ParticipantEntitiesInfo>(
      "ros_discovery_info", {.transient_local = true, .depth = 1});
  if (distro == Distro::kHumble) topic.type_hash.clear();  // That of other messages.
  return topic;
}

std::vector<std::byte> encode(const DiscoveryInfo& info, Distro distro) {
  namespace common = rmw_dds_common;
  if (distro == Distro::kHumble) {
    return encode_as<HumbleParticipant, HumbleNode, HumbleGid>(info);
  }
  return encode_as<common::ParticipantEntitiesInfo, common::NodeEntitiesInfo, common::Gid>(
      info);
}

}  // namespace segsim::ros::dds::internal
