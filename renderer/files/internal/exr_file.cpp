#include "renderer/files/internal/exr_file.h"

#include <algorithm>
#include <exception>
#include <string_view>

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>

#include "core/check.h"
#include "core/error.h"
#include "core/formatted.h"
#include "core/system/remakeable_file.h"
#include "renderer/files/internal/exr_header_check.h"

namespace segsim::renderer::internal {
namespace {

/// A header that claims more is damaged: refused before memory is asked for.
constexpr std::int64_t kMaxPixels = std::int64_t{1} << 28;

/// Only the calling thread works on a file: frames are written side by side instead.
constexpr int kThreads = 0;

Imf::Compression compression_of(ExrCompression compression) {
  switch (compression) {
    case ExrCompression::kNone:
      return Imf::NO_COMPRESSION;
    case ExrCompression::kRle:
      return Imf::RLE_COMPRESSION;
    case ExrCompression::kZips:
      return Imf::ZIPS_COMPRESSION;
    case ExrCompression::kZip:
      return Imf::ZIP_COMPRESSION;
    case ExrCompression::kPiz:
      break;
  }
  return Imf::PIZ_COMPRESSION;
}

std::string size_text(const Imath::Box2i& window) {
  const auto length = [](int first, int last) {
    return std::to_string(std::int64_t{last} - first + 1);
  };
  return length(window.min.x, window.max.x) + " x " + length(window.min.y, window.max.y) +
         " pixels";
}

const std::filesystem::path& checked(const std::filesystem::path& file) {
  check_exr_header(file);
  return file;
}

}  // namespace

void guard_exr(const std::filesystem::path& file, const char* expected,
               const std::function<void()>& action) {
  try {
    action();
  } catch (const core::InputError&) {
    throw;
  } catch (const core::ContractViolation&) {
    throw;
  } catch (const std::exception& error) {
    std::string found = error.what();
    std::replace(found.begin(), found.end(), '\n', ' ');
    throw core::InputError::expected(file.string(), expected, found);
  }
}

void ExrOutput::Part::declare(const std::string& channel, Imf::PixelType type) {
  header_.channels().insert(channel, Imf::Channel(type));
}

ExrOutput::ExrOutput(int width_px, int height_px, float pixel_aspect_ratio,
                     const ExrOptions& options)
    : blank_(width_px, height_px, pixel_aspect_ratio), layout_(options.layout) {
  SEGSIM_CHECK(options.zip_level >= 1 && options.zip_level <= 9, "zip level");
  blank_.compression() = compression_of(options.compression);
  blank_.zipCompressionLevel() = options.zip_level;
  blank_.setType(Imf::SCANLINEIMAGE);
}

ExrOutput::Part& ExrOutput::part(const std::string& name) {
  if (layout_ == ExrLayout::kSinglePart && !parts_.empty()) return parts_.front();
  for (Part& part : parts_) {
    if (part.header().name() == name) return part;
  }
  Part& part = parts_.emplace_back(blank_);
  part.header().setName(layout_ == ExrLayout::kSinglePart ? "all" : name);
  return part;
}

std::vector<ExrOutput::Part*> ExrOutput::parts() {
  std::vector<Part*> filled;
  for (Part& part : parts_) {
    if (!part.empty()) filled.push_back(&part);
  }
  return filled;
}

void ExrOutput::write(const std::filesystem::path& file) {
  const std::vector<Part*> filled = parts();
  SEGSIM_CHECK(!filled.empty(), "no channels");
  const int rows = blank_.dataWindow().max.y - blank_.dataWindow().min.y + 1;
  core::write_remakeable_via_temporary(file, [&](const std::filesystem::path& temporary) {
    guard_exr(file, "a place to write an OpenEXR image", [&] {
      if (filled.size() == 1) {  // An ordinary file, which every reader knows.
        Imf::OutputFile out(temporary.c_str(), filled[0]->header_, kThreads);
        out.setFrameBuffer(filled[0]->buffer_);
        out.writePixels(rows);
        return;
      }
      std::vector<Imf::Header> headers;
      headers.reserve(filled.size());
      for (Part* part : filled) headers.push_back(part->header_);
      Imf::MultiPartOutputFile out(temporary.c_str(), headers.data(),
                                   static_cast<int>(headers.size()), false, kThreads);
      for (std::size_t i = 0; i < filled.size(); ++i) {
        Imf::OutputPart part(out, static_cast<int>(i));
        part.setFrameBuffer(filled[i]->buffer_);
        part.writePixels(rows);
      }
    });
  });
}

ExrInput::ExrInput(const std::filesystem::path& file, const std::string& channel)
    : place_(file.string()), file_(checked(file).c_str(), kThreads) {
  int part = 0;
  if (!channel.empty()) {
    part = part_of(channel);
    if (part < 0) fail("channel " + channel, "none");
  }
  const Imath::Box2i& window = file_.header(part).dataWindow();
  const std::int64_t width = std::int64_t{window.max.x} - window.min.x + 1;
  const std::int64_t height = std::int64_t{window.max.y} - window.min.y + 1;
  if (width < 1 || height < 1 || width > kMaxPixels / height) {
    fail("1 to " + std::to_string(kMaxPixels) + " pixels", size_text(window));
  }
  check_budget();
  width_px_ = static_cast<int>(width);
  height_px_ = static_cast<int>(height);
  wanted_.resize(static_cast<std::size_t>(file_.parts()));
}

/// Memory for pixels is taken before they are read, so a header of a few bytes could ask for
/// gigabytes.
void ExrInput::check_budget() const {
  constexpr double kFreeValues = 16e6, kValuesPerByte = 1024.0;  // What deflate can reach.
  double values = 0.0;
  for (int part = 0; part < file_.parts(); ++part) {
    const Imf::Header& header = file_.header(part);
    const Imath::Box2i& window = header.dataWindow();
    int channels = 0;
    for (auto at = header.channels().begin(); at != header.channels().end(); ++at) ++channels;
    values +=
        (1.0 + window.max.x - window.min.x) * (1.0 + window.max.y - window.min.y) * channels;
  }
  const auto bytes = static_cast<double>(std::filesystem::file_size(place_));
  if (values > kFreeValues + kValuesPerByte * bytes) {
    fail(core::print("a file that can hold the %.0f numbers of its pixels", values),
         core::print("%.0f bytes", bytes));
  }
}

void ExrInput::fail(const std::string& expected, const std::string& found) const {
  throw core::InputError::expected(place_, expected, found);
}

int ExrInput::part_of(const std::string& channel) const {
  for (int part = 0; part < file_.parts(); ++part) {
    const Imf::Header& header = file_.header(part);
    const bool flat = !header.hasType() || !Imf::isDeepData(header.type());
    if (flat && header.channels().findChannel(channel) != nullptr) return part;
  }
  return -1;
}

void ExrInput::want(const std::string& channel, Imf::PixelType type, void* first,
                    std::size_t stride_bytes) {
  const int part = part_of(channel);
  if (part < 0) fail("channel " + channel, "none");
  const Imath::Box2i& window = file_.header(part).dataWindow();
  const std::string size =
      std::to_string(width_px_) + " x " + std::to_string(height_px_) + " pixels";
  if (size_text(window) != size) {
    fail("channel " + channel + " of " + size, size_text(window));
  }
  wanted_[static_cast<std::size_t>(part)].insert(
      channel, Imf::Slice::Make(type, first, window, stride_bytes));
}

bool ExrInput::wants_any() const {
  return std::any_of(wanted_.begin(), wanted_.end(), [](const Imf::FrameBuffer& buffer) {
    return buffer.begin() != buffer.end();
  });
}

std::vector<std::string> ExrInput::attributes_with_prefix(const std::string& prefix) const {
  std::vector<std::string> names;
  for (int part = 0; part < file_.parts(); ++part) {
    const Imf::Header& header = file_.header(part);
    for (auto at = header.begin(); at != header.end(); ++at) {
      if (std::string_view(at.name()).starts_with(prefix)) names.emplace_back(at.name());
    }
  }
  return names;
}

void ExrInput::read() {
  for (int index = 0; index < file_.parts(); ++index) {
    const Imf::FrameBuffer& buffer = wanted_[static_cast<std::size_t>(index)];
    if (buffer.begin() == buffer.end()) continue;
    if (!file_.partComplete(index)) fail("a complete image", "one that was cut off");
    Imf::InputPart part(file_, index);
    part.setFrameBuffer(buffer);
    const Imath::Box2i& window = part.header().dataWindow();
    part.readPixels(window.min.y, window.max.y);
  }
}

}  // namespace segsim::renderer::internal
