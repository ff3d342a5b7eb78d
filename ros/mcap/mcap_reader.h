#pragma once

/// @file
/// Reads MCAP files (ros/mcap/mcap_format.h). A file with a summary is read by its index; one
/// without, or one whose end is missing (the power went, the disk was full), from front to
/// back, as far as its records are whole. Everything else that does not fit the format, and
/// every checksum that does not hold, is bad input.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "ros/mcap/mcap_format.h"

namespace segsim::ros::mcap {

class Reader {
 public:
  /// Reads the index, not the messages.
  /// @throws core::InputError with file, byte, what was expected and what was found, as all
  /// functions do.
  explicit Reader(const std::filesystem::path& file);
  ~Reader();
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  [[nodiscard]] const std::string& profile() const;
  [[nodiscard]] const std::string& library() const;  ///< That wrote the file.
  [[nodiscard]] bool has_index() const;              ///< And it was used.
  /// What is missing at the end of the file; empty if it is whole.
  [[nodiscard]] const std::string& truncation() const;
  /// In order of their numbers in the file.
  [[nodiscard]] std::vector<const Channel*> channels() const;
  [[nodiscard]] const std::vector<Metadata>& metadata() const;
  [[nodiscard]] std::uint64_t message_count() const;

  /// The messages of these topics (none: of all) in order of log time; equal times in the
  /// order of the file.
  void read(const std::function<void(const StoredMessage&)>& receive,
            std::span<const std::string> topics = {});

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace segsim::ros::mcap
