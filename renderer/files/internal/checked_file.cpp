#include "renderer/files/internal/checked_file.h"

#include <ostream>

#include "core/file_io.h"

namespace segsim::renderer::internal {
namespace {

using core::InputError;

constexpr std::size_t kMagicBytes = 8;
constexpr std::size_t kHashBytes = 64;
constexpr std::size_t kHeaderBytes = kMagicBytes + 4 + 8 + kHashBytes;

}  // namespace

void write_checked_file(const std::filesystem::path& file, std::string_view magic,
                        std::uint32_t version, const std::string& payload) {
  ByteWriter header;
  for (const char c : magic) header.put(c);
  header.put(version);
  header.put(static_cast<std::uint64_t>(payload.size()));
  const std::string head = header.bytes + core::sha256_hex(payload);
  core::write_file_atomically(file, [&](std::ostream& out) {
    out.write(head.data(), static_cast<std::streamsize>(head.size()));
    out.write(payload.data(), static_cast<std::streamsize>(payload.size()));
  });
}

CheckedFile read_checked_file(const std::filesystem::path& file, std::string_view magic,
                              const std::string& kind, std::uint32_t newest) {
  const std::string bytes = core::read_file(file);
  const std::string place = file.string();
  if (bytes.size() < kHeaderBytes || !bytes.starts_with(magic)) {
    throw InputError::expected(place, kind + " (" + std::string(magic) + ")",
                               std::to_string(bytes.size()) + " other bytes");
  }
  ByteReader header(bytes, place);
  for (std::size_t i = 0; i < kMagicBytes; ++i) static_cast<void>(header.take<char>());
  CheckedFile result;
  result.version = header.take<std::uint32_t>();
  if (result.version < 1 || result.version > newest) {
    throw InputError::expected(
        place, (newest > 1 ? "version 1 or " : "version ") + std::to_string(newest),
        std::to_string(result.version));
  }
  const auto size = header.take<std::uint64_t>();
  if (size != bytes.size() - kHeaderBytes) {
    throw InputError::expected(place, std::to_string(size) + " bytes of payload",
                               std::to_string(bytes.size() - kHeaderBytes));
  }
  result.payload = bytes.substr(kHeaderBytes);
  if (core::sha256_hex(result.payload) !=
      bytes.substr(kHeaderBytes - kHashBytes, kHashBytes)) {
    throw InputError::expected(place, "a payload with the SHA-256 of its header",
                               "another one");
  }
  return result;
}

}  // namespace segsim::renderer::internal
