#pragma once

/// @file
/// Where a request ends in the bytes of a connection.

#include <cstddef>
#include <string>
#include <string_view>

namespace segsim::experiments::web::internal {

struct RequestEnd {
  enum class State {
    kPartial,
    kWhole,
    kHeadTooLarge,
    kBodyTooLarge,
    /// A length that is none, two of them, or a body in chunks, which no page of ours sends.
    kMalformed,
  };
  State state = State::kPartial;
  std::size_t size = 0;  ///< [bytes], of the first request, if it is whole.
};

[[nodiscard]] RequestEnd request_end(const std::string& bytes, std::size_t largest_head,
                                     std::size_t largest_body);

/// Removes every header of a name from a whole request.
void drop_header(std::string& request, std::string_view name);

}  // namespace segsim::experiments::web::internal
