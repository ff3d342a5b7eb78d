#include "core/system/system_random.h"

#include <sys/random.h>

#include <cerrno>
#include <system_error>
#include <vector>

namespace segsim::core {

std::string random_hex(int bytes) {
  std::vector<unsigned char> drawn(static_cast<std::size_t>(bytes));
  std::size_t have = 0;
  while (have < drawn.size()) {
    const ssize_t got = ::getrandom(drawn.data() + have, drawn.size() - have, 0);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw std::system_error(errno, std::generic_category(), "getrandom");
    have += static_cast<std::size_t>(got);
  }
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string text;
  for (const unsigned char byte : drawn) {
    text += kDigits[byte >> 4U];
    text += kDigits[byte & 15U];
  }
  return text;
}

}  // namespace segsim::core
