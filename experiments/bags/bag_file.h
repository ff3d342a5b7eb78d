#pragma once

/// @file
/// Recordings of ROS 2, however they lie on the disk: an MCAP file, an SQLite file of rosbag2
/// (.db3), or a folder of rosbag2 with several of either, which follow one another.

#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "ros/mcap/mcap_format.h"

namespace segsim::experiments::bags {

class BagFile {
 public:
  /// @throws core::InputError if it is none of these, or damaged.
  explicit BagFile(const std::filesystem::path& path);
  ~BagFile();
  BagFile(const BagFile&) = delete;
  BagFile& operator=(const BagFile&) = delete;

  [[nodiscard]] std::vector<const ros::mcap::Channel*> channels() const;
  /// What is missing at the end of a file; empty if all are whole.
  [[nodiscard]] std::string truncation() const;
  /// The messages of these topics, file by file in order of their times.
  void read(const std::function<void(const ros::mcap::StoredMessage&)>& receive,
            std::span<const std::string> topics);

 private:
  struct Source;
  struct McapSource;
  struct SqliteSource;
  std::vector<std::unique_ptr<Source>> sources_;
};

}  // namespace segsim::experiments::bags
