#pragma once

/// @file
/// What implementations of DDS have in common. Each comes in two files: the one, or the other
/// that says what this program was built without.

#include <memory>

#include "ros/dds/transport.h"

namespace segsim::ros::dds::internal {

[[nodiscard]] std::unique_ptr<Transport> open_cyclone(const TransportOptions& options);
[[nodiscard]] std::unique_ptr<Transport> open_fast(const TransportOptions& options);
[[nodiscard]] bool has_cyclone();
[[nodiscard]] bool has_fast();

/// The topic as DDS knows it: "rt/clock" for "/clock"; in Humble without a type hash.
/// @throws core::InputError if the name is none.
[[nodiscard]] Topic on_wire(const Topic& of_ros, Distro distro);

/// USER_DATA of its endpoints; empty: none.
[[nodiscard]] std::string endpoint_user_data(const Topic& topic);
/// USER_DATA of participants.
inline constexpr const char* kParticipantUserData = "enclave=/;";

}  // namespace segsim::ros::dds::internal
