#include "experiments/support/gzip_file.h"

#include <algorithm>
#include <limits>
#include <ostream>

#include <zlib.h>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"

namespace segsim::experiments::support {
namespace {

constexpr int kGzipWindow = 15 + 16;  // The largest window; +16: gzip, not zlib framing.
constexpr std::size_t kChunk = std::size_t{1} << 16U;

/// zlib reads through pointers to non-const.
Bytef* bytes_of(const std::string& text, std::size_t at) {
  return reinterpret_cast<Bytef*>(const_cast<char*>(text.data() + at));  // NOLINT
}

/// Ends the stream whatever happens.
struct Inflater {
  z_stream stream{};
  Inflater() { SEGSIM_CHECK(inflateInit2(&stream, kGzipWindow) == Z_OK, "zlib"); }
  ~Inflater() { inflateEnd(&stream); }
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;
};

struct Deflater {
  z_stream stream{};
  Deflater() {
    SEGSIM_CHECK(deflateInit2(&stream, Z_BEST_COMPRESSION, Z_DEFLATED, kGzipWindow, 8,
                              Z_DEFAULT_STRATEGY) == Z_OK,
                 "zlib");
  }
  ~Deflater() { deflateEnd(&stream); }
  Deflater(const Deflater&) = delete;
  Deflater& operator=(const Deflater&) = delete;
};

}  // namespace

std::string read_gzip(const std::filesystem::path& file, std::size_t most_bytes) {
  const std::string packed = core::read_file(file);
  const auto refuse = [&](const std::string& found) {
    throw core::InputError::expected(file.string(), "a whole gzip file", found);
  };
  std::string text, chunk(kChunk, '\0');
  Inflater inflater;
  z_stream& stream = inflater.stream;
  std::size_t given = 0;  // Bytes of `packed` that zlib has been handed.
  bool member_ended = false, more_to_come = false;  // zlib still holds unpacked bytes.
  while (true) {
    if (stream.avail_in == 0 && given < packed.size()) {
      const std::size_t share = std::min(packed.size() - given, kChunk);
      stream.next_in = bytes_of(packed, given);
      stream.avail_in = static_cast<uInt>(share);
      given += share;
    }
    if (stream.avail_in == 0 && !more_to_come) {
      if (!member_ended) refuse(packed.empty() ? "an empty file" : "one that is cut short");
      return text;
    }
    if (member_ended) SEGSIM_CHECK(inflateReset(&stream) == Z_OK, "zlib");
    stream.next_out = bytes_of(chunk, 0);
    stream.avail_out = static_cast<uInt>(kChunk);
    const int code = inflate(&stream, Z_NO_FLUSH);
    if (code != Z_OK && code != Z_STREAM_END && code != Z_BUF_ERROR) {
      refuse(stream.msg != nullptr ? stream.msg : "damaged data");
    }
    text.append(chunk, 0, kChunk - stream.avail_out);
    if (text.size() > most_bytes) {
      refuse("more than " + std::to_string(most_bytes) + " bytes in it");
    }
    member_ended = code == Z_STREAM_END;
    more_to_come = !member_ended && stream.avail_out == 0;
  }
}

void write_gzip(const std::filesystem::path& file, const std::string& text) {
  SEGSIM_CHECK(text.size() < std::numeric_limits<uInt>::max(), "text in one piece");
  Deflater deflater;
  z_stream& stream = deflater.stream;
  std::string packed(deflateBound(&stream, static_cast<uLong>(text.size())) + 32, '\0');
  stream.next_in = bytes_of(text, 0);
  stream.avail_in = static_cast<uInt>(text.size());
  stream.next_out = bytes_of(packed, 0);
  stream.avail_out = static_cast<uInt>(packed.size());
  SEGSIM_CHECK(deflate(&stream, Z_FINISH) == Z_STREAM_END, "zlib");
  packed.resize(stream.total_out);
  core::write_file_atomically(file, [&](std::ostream& out) { out << packed; });
}

}  // namespace segsim::experiments::support
