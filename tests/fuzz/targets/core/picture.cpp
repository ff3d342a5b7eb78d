// Whether a PNG or JPEG is whole (core/pictures/picture_check.h).
#include "core/pictures/picture_check.h"

#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/repair.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  (void)core::check_picture(with_png_checksums(bytes), "input");
}

std::vector<std::string> seeds() {
  using namespace std::string_literals;
  const std::string png =
      "\x89PNG\r\n\x1a\n"
      "\0\0\0\x0dIHDR\0\0\0\x03\0\0\0\x02\x08\x02\0\0\0....\0\0\0\0IEND...."s;
  const std::string jpeg =
      "\xff\xd8\xff\xe1\0\x06\xff\xd8\xff\xd9\xff\xc2\0\x0b\x08\0\x02\0\x03\x01\x01\x11\0"
      "\xff\xda\0\x08\x01\x01\0\0\x3f\0\x12\xff\0\x34\xff\xd0\x56\xff\xd9"s;
  return {png, jpeg};
}

}  // namespace segsim::fuzz
