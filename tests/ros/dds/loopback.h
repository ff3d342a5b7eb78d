#pragma once

// What keeps a test's traffic on this machine, also where there is no network at all.

namespace segsim::ros::dds {

inline constexpr const char* kLoopback =
    "<General><Interfaces><NetworkInterface name=\"lo\"/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General>"
    "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery>";

}  // namespace segsim::ros::dds
