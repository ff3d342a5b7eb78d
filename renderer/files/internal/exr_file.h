#pragma once

/// @file
/// OpenEXR files as named channels in named parts. The library's types and exceptions end here
/// and in exr_io.cpp.

#include <cstddef>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <type_traits>
#include <vector>

#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <half.h>

#include "renderer/files/exr_io.h"

namespace segsim::renderer::internal {

template <class Value>
constexpr Imf::PixelType exr_pixel_type() {
  if constexpr (std::is_same_v<Value, half>) {
    return Imf::HALF;
  } else if constexpr (std::is_same_v<Value, float>) {
    return Imf::FLOAT;
  } else {
    static_assert(std::is_same_v<Value, unsigned int>);
    return Imf::UINT;
  }
}

/// Calls `action` and turns the library's exceptions into core::InputError, one line.
void guard_exr(const std::filesystem::path& file, const char* expected,
               const std::function<void()>& action);

/// Images of one size on their way to a file. Pixels are borrowed until write() has returned.
class ExrOutput {
 public:
  class Part {
   public:
    explicit Part(Imf::Header header) : header_(std::move(header)) {}
    /// @param stride  Values from one pixel to the next.
    template <class Value>
    void add(const std::string& channel, const Value* first, std::size_t stride = 1) {
      declare(channel, exr_pixel_type<Value>());
      buffer_.insert(channel, Imf::Slice::Make(exr_pixel_type<Value>(), first,
                                               header_.dataWindow(), sizeof(Value) * stride));
    }
    /// A channel of zeros.
    void declare(const std::string& channel, Imf::PixelType type);
    [[nodiscard]] bool empty() const { return buffer_.begin() == buffer_.end(); }
    Imf::Header& header() { return header_; }

   private:
    friend class ExrOutput;
    Imf::Header header_;
    Imf::FrameBuffer buffer_;
  };

  ExrOutput(int width_px, int height_px, float pixel_aspect_ratio, const ExrOptions& options);

  /// The part of that name, made if need be; with kSinglePart always the same one.
  Part& part(const std::string& name);
  /// Parts that have channels, in the order in which they were asked for.
  [[nodiscard]] std::vector<Part*> parts();
  void write(const std::filesystem::path& file);

 private:
  Imf::Header blank_;
  ExrLayout layout_;
  std::deque<Part> parts_;
};

/// An open file. Channels are looked up in all flat parts, the first one wins.
class ExrInput {
 public:
  /// The size is that of the first part, or of the part that has `channel`.
  /// @throws core::InputError if `channel` is given and there is none.
  explicit ExrInput(const std::filesystem::path& file, const std::string& channel = {});

  [[nodiscard]] int width_px() const { return width_px_; }
  [[nodiscard]] int height_px() const { return height_px_; }
  [[nodiscard]] bool has(const std::string& channel) const { return part_of(channel) >= 0; }

  /// Asks for a channel; values are converted. The memory is filled by read().
  /// @throws core::InputError if there is none of the file's size.
  template <class Value>
  void want(const std::string& channel, Value* first, std::size_t stride = 1) {
    want(channel, exr_pixel_type<Value>(), first, sizeof(Value) * stride);
  }
  [[nodiscard]] bool wants_any() const;
  /// Reads what was asked for; decodes each part at most once.
  void read();

  /// Null if no part has it.
  template <class Attribute>
  [[nodiscard]] const Attribute* find(const std::string& name) const {
    for (int part = 0; part < file_.parts(); ++part) {
      if (const auto* found = file_.header(part).findTypedAttribute<Attribute>(name)) {
        return found;
      }
    }
    return nullptr;
  }
  /// @throws core::InputError if no part has it.
  template <class Attribute>
  [[nodiscard]] auto attribute(const std::string& name) const {
    const Attribute* found = find<Attribute>(name);
    if (found == nullptr) fail("attribute " + name, "none");
    return found->value();
  }

  /// Of all parts.
  [[nodiscard]] std::vector<std::string> attributes_with_prefix(
      const std::string& prefix) const;

  [[nodiscard]] const std::string& place() const { return place_; }
  [[noreturn]] void fail(const std::string& expected, const std::string& found) const;

 private:
  [[nodiscard]] int part_of(const std::string& channel) const;
  void check_budget() const;
  void want(const std::string& channel, Imf::PixelType type, void* first,
            std::size_t stride_bytes);

  std::string place_;
  Imf::MultiPartInputFile file_;
  int width_px_ = 0, height_px_ = 0;
  std::vector<Imf::FrameBuffer> wanted_;  ///< By part.
};

}  // namespace segsim::renderer::internal
