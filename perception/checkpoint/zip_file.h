#pragma once

/// @file
/// Lists the records of a zip file, as far as torch uses the format: tensors and structure are
/// stored, neither compressed nor encrypted; sizes up to 64 bit. Everything is checked against
/// the bytes at hand; nothing is unpacked.

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace segsim::perception {

struct ZipRecord {
  std::string name;
  std::size_t offset = 0, size = 0;  ///< Of the data, inside the file.
  std::uint32_t crc = 0;             ///< CRC-32 that the file states.
  bool plain = true;                 ///< Neither compressed nor encrypted.
};

/// Whether the bytes begin like a zip file.
[[nodiscard]] bool is_zip(std::string_view bytes);

/// @throws core::InputError that starts with `place` for a damaged file or one name
/// twice.
[[nodiscard]] std::vector<ZipRecord> list_zip(std::string_view bytes,
                                              const std::string& place);

/// The bytes of a record.
/// @throws core::InputError if they are not plain or do not have the stated CRC.
[[nodiscard]] std::string_view read_record(std::string_view bytes, const ZipRecord& record,
                                           const std::string& place);

}  // namespace segsim::perception
