#pragma once

/// @file
/// A type of Cyclone DDS whose samples are bytes that are XCDR1 already: they pass through as
/// they are, and Cyclone needs no description of the type. It has no key.

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include <dds/dds.h>

struct ddsi_sertype;
struct ddsi_serdata;

namespace segsim::ros::dds::internal {

/// One reference, for dds_create_topic_sertype() to take.
[[nodiscard]] ddsi_sertype* make_raw_type(const std::string& type_name);

/// One reference, for dds_writecdr() to take. @param cdr  With its encapsulation.
[[nodiscard]] ddsi_serdata* make_raw_sample(const ddsi_sertype* type,
                                            std::span<const std::byte> cdr);

/// Copies what was received, with its encapsulation.
void copy_raw_sample(const ddsi_serdata* sample, std::vector<std::byte>& cdr);

}  // namespace segsim::ros::dds::internal
