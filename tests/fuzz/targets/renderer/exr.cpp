// Rendered views, and any program's depth and Cryptomatte images (renderer/files/exr_io.h).
#include "renderer/files/exr_io.h"

#include <array>
#include <cstring>

#include "core/error.h"
#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {
namespace {

core::Frame small_frame() {
  core::Frame frame;
  frame.intrinsics = core::CameraIntrinsics::from_fov(4, 3, 1.2);
  frame.rgb = core::Image<core::Rgb8>(4, 3, {1, 2, 3});
  frame.depth_m = core::Image<float>(4, 3, 1.5F);
  frame.semantic = core::Image<std::uint16_t>(4, 3, 1);
  frame.instance = core::Image<std::uint16_t>(4, 3, 257);
  return frame;
}

/// Whether a header asks for many pixels, and yet for fewer than the reader refuses: filling
/// them takes as long as a thousand other inputs.
bool has_many_pixels(const std::string& bytes) {
  constexpr std::int64_t kMany = 1 << 14, kRefused = 100'000'000;
  const std::string name("dataWindow\0box2i\0\x10\0\0\0", 21);
  for (auto at = bytes.find(name); at != std::string::npos; at = bytes.find(name, at + 1)) {
    std::array<std::int32_t, 4> window{};
    if (bytes.size() < at + name.size() + sizeof window) return false;
    std::memcpy(window.data(), bytes.data() + at + name.size(), sizeof window);
    const std::int64_t width = std::int64_t{window[2]} - window[0] + 1;
    const std::int64_t height = std::int64_t{window[3]} - window[1] + 1;
    if (width < 1 || height < 1 || width > kRefused || height > kRefused) continue;
    if (width * height > kMany && width * height < kRefused) return true;
  }
  return false;
}

template <class Read>
bool reads(const Read& read) {
  try {
    (void)read();
    return true;
  } catch (const core::InputError&) {
    return false;
  }
}

}  // namespace

void parse(const std::string& bytes) {
  if (has_many_pixels(bytes)) return;
  const std::filesystem::path file = in_file(bytes, "view.exr");
  const bool taken =
      reads([&] { return renderer::read_depth_exr(file); }) &&
      reads([&] { return renderer::read_frame_info_exr(file); }) &&
      reads([&] { return renderer::read_cryptomatte_exr(file, "CryptoInstance"); });
  const core::Frame frame = renderer::read_frame_exr(file);
  if (!taken) throw core::InputError("no depth, no facts or no Cryptomatte");
}

std::vector<std::string> seeds() {
  renderer::FrameInfo info;
  info.scene = "flat";
  info.time_ns = 5;
  std::vector<std::string> all;
  for (const auto layout :
       {renderer::ExrLayout::kMultiPart, renderer::ExrLayout::kSinglePart}) {
    for (const auto compression :
         {renderer::ExrCompression::kNone, renderer::ExrCompression::kRle,
          renderer::ExrCompression::kZip, renderer::ExrCompression::kPiz}) {
      all.push_back(written([&](const auto& file) {
        renderer::write_frame_exr(file, small_frame(), info, {layout, compression});
      }));
    }
  }
  return all;
}

}  // namespace segsim::fuzz
