// Where a request ends in the bytes of a connection (experiments/web/internal).
#include "experiments/web/internal/request_bytes.h"

#include <cstdlib>

#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

using namespace experiments::web::internal;

void parse(const std::string& bytes) {
  constexpr std::size_t kLargestHead = 16384, kLargestBody = 4096;
  const RequestEnd end = request_end(bytes, kLargestHead, kLargestBody);
  if (end.state != RequestEnd::State::kWhole) return;
  if (end.size == 0 || end.size > bytes.size()) std::abort();
  std::string request = bytes.substr(0, end.size);
  // What comes behind a request decides nothing about it.
  if (request_end(request, kLargestHead, kLargestBody).size != end.size) std::abort();
  drop_header(request, "Range");
  if (request_end(request, kLargestHead, kLargestBody).state != RequestEnd::State::kWhole) {
    std::abort();
  }
}

std::vector<std::string> seeds() {
  return {"GET /a/b?c=d HTTP/1.1\r\nHost: localhost\r\nRange: bytes=0-1\r\n\r\n",
          "POST /x HTTP/1.1\r\nHost: a\r\nContent-Length: 2\r\n\r\n{}GET / HTTP/1.1\r\n\r\n"};
}

}  // namespace segsim::fuzz
