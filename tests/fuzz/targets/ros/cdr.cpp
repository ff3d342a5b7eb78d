// Messages of ROS 2 as bytes (ros/cdr.h). The first byte of the input says which message.
#include "ros/cdr.h"

#include <tuple>
#include <utility>

#include "ros/messages/all_messages.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/ros/filled_message.h"

namespace segsim::fuzz {
namespace {

constexpr std::size_t kTypes = std::tuple_size_v<ros::AllMessages>;

template <std::size_t I>
using TypeAt = std::tuple_element_t<I, ros::AllMessages>;

template <std::size_t... I>
void decode(std::size_t type, std::span<const std::byte> bytes, std::index_sequence<I...>) {
  ((type == I ? (void)ros::encode_cdr(ros::decode_cdr<TypeAt<I>>(bytes, "input")) : void()),
   ...);
}

template <std::size_t... I>
std::vector<std::string> encoded(std::index_sequence<I...>) {
  std::vector<std::string> all;
  const auto add = [&](std::size_t type, const std::vector<std::byte>& bytes) {
    all.push_back(static_cast<char>(type) +
                  std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
  };
  (add(I, ros::encode_cdr(ros::filled_message<TypeAt<I>>(3))), ...);
  return all;
}

}  // namespace

void parse(const std::string& bytes) {
  if (bytes.empty()) return;
  const auto type = static_cast<unsigned char>(bytes.front()) % kTypes;
  decode(type, std::as_bytes(std::span(bytes)).subspan(1), std::make_index_sequence<kTypes>());
}

std::vector<std::string> seeds() { return encoded(std::make_index_sequence<kTypes>()); }

}  // namespace segsim::fuzz
