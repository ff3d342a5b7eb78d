#include "ros/mcap/internal/compression.h"

#include <algorithm>
#include <functional>
#include <memory>

#include <lz4frame.h>
#include <zstd.h>

#include "core/check.h"
#include "core/error.h"

namespace segsim::ros::mcap::internal {
namespace {

constexpr int kZstdLevel = 1;
/// Decompression asks for so much memory at least.
constexpr std::size_t kFirstBytes = 1U << 20U;

LZ4F_preferences_t lz4_preferences(std::size_t size) {
  LZ4F_preferences_t preferences = LZ4F_INIT_PREFERENCES;
  preferences.frameInfo.blockSizeID = LZ4F_max4MB;
  // Independent blocks need no copy of what came before.
  preferences.frameInfo.blockMode = LZ4F_blockIndependent;
  preferences.frameInfo.contentSize = size;
  return preferences;
}

/// One step of a decompressor: consumes from `in`, fills `out`, returns the bytes of both;
/// `done` at the end of the frame.
struct Step {
  std::size_t consumed = 0, produced = 0;
  bool done = false;
  const char* error = nullptr;
};
using StepFunction =
    std::function<Step(std::span<const std::byte> in, std::span<std::byte> out)>;

std::vector<std::byte> run(std::span<const std::byte> bytes, std::uint64_t size,
                           const std::string& place, const char* name,
                           const StepFunction& step) {
  std::vector<std::byte> out;
  std::size_t filled = 0;
  const auto expect = [&](const std::string& found) -> core::InputError {
    return core::InputError::expected(
        place, std::to_string(size) + " bytes compressed by " + name, found);
  };
  while (true) {
    // One byte more than promised shows what is too long.
    if (filled == out.size()) {
      const std::uint64_t more = std::max<std::uint64_t>(2 * out.size(), kFirstBytes);
      out.resize(static_cast<std::size_t>(std::min<std::uint64_t>(more, size + 1)));
      if (filled == out.size()) throw expect("more");
    }
    const Step done = step(bytes, std::span(out).subspan(filled));
    if (done.error != nullptr) throw expect(done.error);
    filled += done.produced;
    bytes = bytes.subspan(done.consumed);
    if (done.done) break;
    if (done.consumed == 0 && done.produced == 0) {
      throw expect("their end after " + std::to_string(filled));
    }
  }
  if (!bytes.empty()) throw expect("more behind them");
  if (filled != size) throw expect(std::to_string(filled));
  out.resize(filled);
  return out;
}

std::vector<std::byte> decompress_lz4(std::span<const std::byte> bytes, std::uint64_t size,
                                      const std::string& place) {
  LZ4F_dctx* made = nullptr;
  SEGSIM_CHECK(!LZ4F_isError(LZ4F_createDecompressionContext(&made, LZ4F_VERSION)), "LZ4");
  const std::unique_ptr<LZ4F_dctx, decltype(&LZ4F_freeDecompressionContext)> context(
      made, &LZ4F_freeDecompressionContext);
  return run(bytes, size, place, "lz4", [&](auto in, auto out) {
    Step step{in.size(), out.size(), false, nullptr};
    const std::size_t left = LZ4F_decompress(context.get(), out.data(), &step.produced,
                                             in.data(), &step.consumed, nullptr);
    if (LZ4F_isError(left)) step.error = LZ4F_getErrorName(left);
    step.done = left == 0;
    return step;
  });
}

std::vector<std::byte> decompress_zstd(std::span<const std::byte> bytes, std::uint64_t size,
                                       const std::string& place) {
  const std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context(ZSTD_createDCtx(),
                                                                     &ZSTD_freeDCtx);
  SEGSIM_CHECK(context != nullptr, "zstd");
  return run(bytes, size, place, "zstd", [&](auto in, auto out) {
    ZSTD_inBuffer from{in.data(), in.size(), 0};
    ZSTD_outBuffer to{out.data(), out.size(), 0};
    const std::size_t left = ZSTD_decompressStream(context.get(), &to, &from);
    Step step{from.pos, to.pos, left == 0, nullptr};
    if (ZSTD_isError(left)) step.error = ZSTD_getErrorName(left);
    return step;
  });
}

}  // namespace

std::string name_in_file(Compression compression) {
  return compression == Compression::kNone ? "" : to_string(compression);
}

Compressor::Compressor(Compression compression) : compression_(compression) {
  if (compression != Compression::kZstd) return;
  zstd_ = ZSTD_createCCtx();
  SEGSIM_CHECK(zstd_ != nullptr, "zstd");
}

Compressor::~Compressor() { ZSTD_freeCCtx(static_cast<ZSTD_CCtx*>(zstd_)); }

std::span<const std::byte> Compressor::compress(std::span<const std::byte> bytes) {
  if (compression_ == Compression::kNone) return bytes;
  if (compression_ == Compression::kZstd) {
    buffer_.resize(std::max(buffer_.size(), ZSTD_compressBound(bytes.size())));
    const std::size_t size =
        ZSTD_compressCCtx(static_cast<ZSTD_CCtx*>(zstd_), buffer_.data(), buffer_.size(),
                          bytes.data(), bytes.size(), kZstdLevel);
    SEGSIM_CHECK(!ZSTD_isError(size), ZSTD_getErrorName(size));
    return std::span(buffer_).first(size);
  }
  const LZ4F_preferences_t preferences = lz4_preferences(bytes.size());
  buffer_.resize(
      std::max(buffer_.size(), LZ4F_compressFrameBound(bytes.size(), &preferences)));
  const std::size_t size = LZ4F_compressFrame(buffer_.data(), buffer_.size(), bytes.data(),
                                              bytes.size(), &preferences);
  SEGSIM_CHECK(!LZ4F_isError(size), LZ4F_getErrorName(size));
  return std::span(buffer_).first(size);
}

std::vector<std::byte> decompress(std::span<const std::byte> bytes, const std::string& name,
                                  std::uint64_t size, const std::string& place) {
  if (name == "lz4") return decompress_lz4(bytes, size, place);
  if (name == "zstd") return decompress_zstd(bytes, size, place);
  if (!name.empty()) {
    throw core::InputError::expected(place, "compression lz4, zstd or none", name);
  }
  if (bytes.size() != size) {
    throw core::InputError::expected(place, std::to_string(size) + " bytes",
                                     std::to_string(bytes.size()));
  }
  return {bytes.begin(), bytes.end()};
}

}  // namespace segsim::ros::mcap::internal
