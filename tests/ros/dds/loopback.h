#pragma once

// What keeps a test's traffic on this machine, also where there is no network at all.

namespace segsim::ros::dds {

inline constexpr const char* kLoopback =
    "<General><Interfaces><NetworkInterface name=\"lo\"/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General>"
    "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery>";

/// The same for Fast DDS, whose participants in one process are numbered on and on.
inline constexpr const char* kFastLoopback = R"(<?xml version="1.0" encoding="UTF-8"?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <transport_descriptors><transport_descriptor>
    <transport_id>lo</transport_id><type>UDPv4</type>
    <maxInitialPeersRange>100</maxInitialPeersRange>
    <interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>
  </transport_descriptor></transport_descriptors>
  <participant profile_name="segsim"><rtps>
    <userTransports><transport_id>lo</transport_id></userTransports>
    <useBuiltinTransports>false</useBuiltinTransports>
    <builtin><initialPeersList>
      <locator><udpv4><address>127.0.0.1</address></udpv4></locator>
    </initialPeersList></builtin>
  </rtps></participant>
</profiles>)";

}  // namespace segsim::ros::dds
