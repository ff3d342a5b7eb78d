#include "peers/shared_images.h"

#include <cerrno>
#include <cstring>
#include <utility>

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/error.h"

namespace segsim::peers {
namespace {

constexpr std::size_t kAlignment_bytes = 64;

[[noreturn]] void fail(const std::string& name) {
  throw core::InputError::expected(name, "memory for images", std::strerror(errno));
}

/// The place of an image after `end_bytes`, which moves behind it.
template <class Pixel>
ImagePlace place(const core::Image<Pixel>* image, std::size_t& end_bytes) {
  if (image == nullptr || image->empty()) return {};
  const std::size_t begin = end_bytes;
  const std::size_t behind = begin + image->size() * sizeof(Pixel);
  end_bytes = (behind + kAlignment_bytes - 1) / kAlignment_bytes * kAlignment_bytes;
  return {begin, image->width_px(), image->height_px()};
}

template <class Pixel>
void copy_out(const core::Image<Pixel>* image, const ImagePlace& to,
              const MappedBytes& bytes) {
  if (to.width_px == 0) return;
  std::memcpy(bytes.data() + to.offset_bytes, image->data(), image->size() * sizeof(Pixel));
}

template <class Pixel>
void copy_in(const ImagePlace& from, const MappedBytes& bytes, const std::string& name,
             core::Image<Pixel>& image) {
  image.resize(from.width_px, from.height_px);
  const std::size_t count = image.size() * sizeof(Pixel);
  if (from.offset_bytes > bytes.size() || count > bytes.size() - from.offset_bytes) {
    throw core::InputError::expected(name, "images inside the memory", "one beyond its end");
  }
  if (count > 0) std::memcpy(image.data(), bytes.data() + from.offset_bytes, count);
}

}  // namespace

MappedBytes::MappedBytes(int fd, std::size_t bytes, bool writable, const std::string& name)
    : bytes_(bytes) {
  void* mapped =
      ::mmap(nullptr, bytes, writable ? PROT_READ | PROT_WRITE : PROT_READ, MAP_SHARED, fd, 0);
  if (mapped == MAP_FAILED) fail(name);
  data_ = static_cast<std::byte*>(mapped);
}

MappedBytes::MappedBytes(MappedBytes&& other) noexcept
    : data_(std::exchange(other.data_, nullptr)), bytes_(std::exchange(other.bytes_, 0)) {}

MappedBytes& MappedBytes::operator=(MappedBytes&& other) noexcept {
  std::swap(data_, other.data_);
  std::swap(bytes_, other.bytes_);
  return *this;
}

MappedBytes::~MappedBytes() {
  if (data_ != nullptr) ::munmap(data_, bytes_);
}

ImagePlaces SharedImages::put(const core::Observation& observation) {
  ImagePlaces places;
  std::size_t bytes = 0;
  places.rgb = place(observation.rgb, bytes);
  places.depth_m = place(observation.depth_m, bytes);
  if (bytes == 0) return places;
  if (!memory_.is_open()) {
    memory_ = OwnedFd(::memfd_create("segsim-images", MFD_CLOEXEC | MFD_ALLOW_SEALING));
    // Whoever maps it cannot cut it off under the other.
    if (!memory_.is_open() || ::fcntl(memory_.get(), F_ADD_SEALS, F_SEAL_SHRINK) != 0) {
      fail("images for another program");
    }
  }
  if (bytes > bytes_.size()) {
    if (::ftruncate(memory_.get(), static_cast<off_t>(bytes)) != 0) {
      fail("images for another program");
    }
    bytes_ = MappedBytes(memory_.get(), bytes, true, "images for another program");
  }
  copy_out(observation.rgb, places.rgb, bytes_);
  copy_out(observation.depth_m, places.depth_m, bytes_);
  places.file = "/proc/" + std::to_string(::getpid()) + "/fd/" + std::to_string(memory_.get());
  places.bytes = bytes_.size();
  return places;
}

void SharedImageReader::get(const ImagePlaces& places, core::Image<core::Rgb8>& rgb,
                            core::Image<float>& depth_m) {
  if (places.bytes > 0 && (places.file != file_ || places.bytes != bytes_.size())) {
    const OwnedFd memory(::open(places.file.c_str(), O_RDONLY | O_CLOEXEC));
    struct stat found = {};
    if (!memory.is_open() || ::fstat(memory.get(), &found) != 0) fail(places.file);
    if (static_cast<std::size_t>(found.st_size) < places.bytes) {
      throw core::InputError::expected(places.file, std::to_string(places.bytes) + " bytes",
                                       std::to_string(found.st_size));
    }
    bytes_ = MappedBytes(memory.get(), places.bytes, false, places.file);
    file_ = places.file;
  }
  copy_in(places.rgb, bytes_, places.file, rgb);
  copy_in(places.depth_m, bytes_, places.file, depth_m);
}

}  // namespace segsim::peers
