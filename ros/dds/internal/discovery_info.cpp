#include "ros/dds/internal/discovery_info.h"

#include <algorithm>

#include "ros/cdr.h"
#include "ros/messages/rmw_dds_common.h"

namespace segsim::ros::dds::internal {
namespace {

namespace common = rmw_dds_common;

template <std::size_t kBytes>
common::GidOf<kBytes> gid_of(const Guid& guid) {
  common::GidOf<kBytes> gid;
  std::copy(guid.begin(), guid.end(), gid.data.begin());
  return gid;
}

/// @tparam kBytes  Of an identifier.
template <std::size_t kBytes>
std::vector<std::byte> encode_with(const DiscoveryInfo& info) {
  common::ParticipantEntitiesInfoOf<kBytes> participant;
  participant.gid = gid_of<kBytes>(info.participant);
  auto& node = participant.node_entities_info_seq.emplace_back();
  node.node_namespace.assign("/");
  node.node_name.assign(info.node);
  for (const Guid& guid : info.readers) node.reader_gid_seq.push_back(gid_of<kBytes>(guid));
  for (const Guid& guid : info.writers) node.writer_gid_seq.push_back(gid_of<kBytes>(guid));
  return encode_cdr(participant);
}

}  // namespace

Topic discovery_topic(Distro distro) {
  Topic topic = topic_of<common::ParticipantEntitiesInfo>(
      "ros_discovery_info", {.transient_local = true, .depth = 1});
  if (distro == Distro::kHumble) topic.type_hash.clear();  // That of other messages.
  return topic;
}

std::vector<std::byte> encode(const DiscoveryInfo& info, Distro distro) {
  return distro == Distro::kHumble ? encode_with<24>(info) : encode_with<16>(info);
}

}  // namespace segsim::ros::dds::internal
