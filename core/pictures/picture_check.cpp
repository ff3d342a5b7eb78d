#include "core/pictures/picture_check.h"

#include <algorithm>
#include <cstdint>

#include "core/error.h"
#include "core/input/bounds.h"
#include "core/input/crc32.h"

namespace segsim::core {
namespace {

constexpr std::string_view kPngSignature{"\x89PNG\r\n\x1a\n", 8};
constexpr std::string_view kJpegStart{"\xff\xd8", 2};

std::uint32_t big_endian(std::string_view bytes, std::size_t at, std::size_t count) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < count; ++i) {
    value = (value << 8U) | static_cast<unsigned char>(bytes[at + i]);
  }
  return value;
}

std::string at_byte(std::size_t at, std::size_t size) {
  return "the end of the file at byte " + std::to_string(size) + " (read up to byte " +
         std::to_string(at) + ")";
}

struct WideSize {
  std::uint32_t width_px = 0, height_px = 0;
};

/// As soon as it is known: a picture that is too large is told so, whole or not.
WideSize checked_size(const WideSize& size, const std::string& place) {
  const std::uint64_t pixels = std::uint64_t{size.width_px} * size.height_px;
  if (pixels > 0 && pixels <= static_cast<std::uint64_t>(kMostPixels)) return size;
  throw InputError::expected(
      place, pixels == 0 ? "an image" : "at most " + std::to_string(kMostPixels) + " pixels",
      std::to_string(size.width_px) + " x " + std::to_string(size.height_px));
}

WideSize check_png(std::string_view bytes, const std::string& place) {
  WideSize size;
  std::size_t at = kPngSignature.size();
  while (true) {
    if (bytes.size() >= at + 16 && bytes.substr(at + 4, 4) == "IHDR") {
      size =
          checked_size({big_endian(bytes, at + 8, 4), big_endian(bytes, at + 12, 4)}, place);
    }
    if (bytes.size() < at + 12) {
      throw InputError::expected(place, "a complete PNG file (IEND chunk)",
                                 at_byte(at, bytes.size()));
    }
    const std::size_t length = big_endian(bytes, at, 4);
    const std::string_view type = bytes.substr(at + 4, 4);
    if (bytes.size() - at - 12 < length) {
      throw InputError::expected(place, "a complete PNG file (IEND chunk)",
                                 at_byte(at, bytes.size()));
    }
    if (crc32(bytes.substr(at + 4, length + 4)) != big_endian(bytes, at + 8 + length, 4)) {
      throw InputError::expected(
          place, "intact PNG data",
          "a wrong checksum in the chunk at byte " + std::to_string(at));
    }
    if (type == "IEND") return size;
    at += length + 12;
  }
}

constexpr unsigned kEndOfImage = 0xD9, kStartOfScan = 0xDA;

/// Frame headers carry the size: SOF0 ... SOF15 without DHT (C4), JPG (C8) and DAC (CC).
bool is_frame_header(unsigned marker) {
  return marker >= 0xC0U && marker <= 0xCFU && marker != 0xC4U && marker != 0xC8U &&
         marker != 0xCCU;
}

/// Markers without a length: TEM, RST0 ... RST7, SOI.
bool stands_alone(unsigned marker) {
  return marker == 0x01U || (marker >= 0xD0U && marker <= 0xD8U);
}

/// Segments: any number of fill bytes FF, a marker, its length and content. After the header
/// of a scan come its data, in which FF 00 stands for a byte FF and FF D0 ... D7 for a
/// restart.
WideSize check_jpeg(std::string_view bytes, const std::string& place) {
  WideSize size;
  const auto byte = [&](std::size_t i) {
    return static_cast<unsigned>(static_cast<unsigned char>(bytes[i]));
  };
  bool in_scan = false;
  std::size_t at = kJpegStart.size();
  while (at + 2 <= bytes.size()) {
    const unsigned marker = byte(at + 1);
    if (byte(at) != 0xFFU || marker == 0xFFU) {  // Decoders skip stray bytes, too.
      ++at;
    } else if (marker == 0U || stands_alone(marker)) {
      at += 2;
    } else if (marker == kEndOfImage) {
      if (!in_scan || size.width_px == 0) break;
      return size;
    } else if (at + 4 > bytes.size()) {
      break;
    } else {
      if (is_frame_header(marker) && at + 9 <= bytes.size()) {
        size =
            checked_size({big_endian(bytes, at + 7, 2), big_endian(bytes, at + 5, 2)}, place);
      }
      in_scan = marker == kStartOfScan;
      at += 2 + big_endian(bytes, at + 2, 2);
    }
  }
  throw InputError::expected(place, "a complete JPEG file (end marker FFD9)",
                             at_byte(std::min(at, bytes.size()), bytes.size()));
}

}  // namespace

bool is_png_or_jpeg(std::string_view bytes) {
  return bytes.starts_with(kPngSignature) || bytes.starts_with(kJpegStart);
}

PictureSize check_picture(std::string_view bytes, const std::string& place) {
  if (!is_png_or_jpeg(bytes)) {
    throw InputError::expected(place, "a PNG or JPEG image",
                               bytes.empty() ? "an empty file" : "another format");
  }
  const WideSize size =
      bytes.starts_with(kJpegStart) ? check_jpeg(bytes, place) : check_png(bytes, place);
  static_cast<void>(checked_size(size, place));  // A PNG may lack the chunk that has it.
  return {static_cast<int>(size.width_px), static_cast<int>(size.height_px)};
}

}  // namespace segsim::core
