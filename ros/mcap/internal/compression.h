#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "ros/mcap/mcap_format.h"

namespace segsim::ros::mcap::internal {

/// How the format writes it: "", "lz4", "zstd".
[[nodiscard]] std::string name_in_file(Compression compression);

/// Compresses chunks one after another: an LZ4 frame, a Zstandard frame. Fast rather than
/// small.
class Compressor {
 public:
  explicit Compressor(Compression compression);
  ~Compressor();
  Compressor(const Compressor&) = delete;
  Compressor& operator=(const Compressor&) = delete;

  /// Valid until the next call; what is not compressed is `bytes` itself.
  [[nodiscard]] std::span<const std::byte> compress(std::span<const std::byte> bytes);

 private:
  Compression compression_;
  void* zstd_ = nullptr;  // ZSTD_CCtx
  std::vector<std::byte> buffer_;
};

/// @param name  As in the file. @param size  Of what must come out. Memory grows with what
/// comes out, not with what was promised.
/// @throws core::InputError that begins with `place`.
[[nodiscard]] std::vector<std::byte> decompress(std::span<const std::byte> bytes,
                                                const std::string& name, std::uint64_t size,
                                                const std::string& place);

}  // namespace segsim::ros::mcap::internal
