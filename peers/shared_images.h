#pragma once

/// @file
/// Images of one observation in memory that another process of this machine maps. The memory
/// has no name in any folder and goes with the process that made it.

#include <cstddef>
#include <string>

#include "core/image.h"
#include "core/stages.h"
#include "peers/channel.h"

namespace segsim::peers {

/// Where an image is; rows without padding.
struct ImagePlace {
  std::size_t offset_bytes = 0;
  int width_px = 0, height_px = 0;  ///< 0: there is none.
};

/// What a message tells of the images of its observation.
struct ImagePlaces {
  std::string file;       ///< To be opened and mapped for reading.
  std::size_t bytes = 0;  ///< Its size. It grows with the images, and is mapped anew then.
  ImagePlace rgb;         ///< uint8 [height, width, 3], sRGB.
  ImagePlace depth_m;     ///< float32 [height, width], metres along +z, NaN: not measured.
};

/// Memory mapped from a file descriptor.
class MappedBytes {
 public:
  MappedBytes() = default;
  /// @throws core::InputError if it cannot be mapped.
  MappedBytes(int fd, std::size_t bytes, bool writable, const std::string& name);
  MappedBytes(MappedBytes&& other) noexcept;
  MappedBytes& operator=(MappedBytes&& other) noexcept;
  ~MappedBytes();

  [[nodiscard]] std::byte* data() const { return data_; }
  [[nodiscard]] std::size_t size() const { return bytes_; }

 private:
  std::byte* data_ = nullptr;
  std::size_t bytes_ = 0;
};

/// The side that writes.
class SharedImages {
 public:
  /// Copies the images of an observation over those before it.
  /// @throws core::InputError if the machine gives no memory.
  [[nodiscard]] ImagePlaces put(const core::Observation& observation);

 private:
  OwnedFd memory_;
  MappedBytes bytes_;
};

/// The side that reads.
class SharedImageReader {
 public:
  /// Fills the images that are there; the others become empty.
  /// @throws core::InputError if the memory cannot be opened or is smaller than it is said to
  /// be.
  void get(const ImagePlaces& places, core::Image<core::Rgb8>& rgb,
           core::Image<float>& depth_m);

 private:
  std::string file_;
  MappedBytes bytes_;
};

}  // namespace segsim::peers
