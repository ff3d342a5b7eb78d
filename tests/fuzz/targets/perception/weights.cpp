// Weights of ours: header, then tensors under a hash, which is repaired
// (perception/checkpoint/weights_file.h).
#include <cstring>

#include "core/file_io.h"
#include "perception/checkpoint/weights_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {
namespace {

/// The hash of what follows the header, where the header states one of its length.
std::string with_hash(std::string bytes) {
  constexpr std::size_t kHeader = 12, kDigits = 64;
  const std::string key = "\"data_sha256\":\"";
  std::uint32_t length = 0;
  if (bytes.size() < kHeader) return bytes;
  std::memcpy(&length, bytes.data() + 8, sizeof length);
  if (length > bytes.size() - kHeader) return bytes;
  const std::size_t at = bytes.find(key);
  if (at == std::string::npos || at + key.size() + kDigits > kHeader + length) return bytes;
  return bytes.replace(at + key.size(), kDigits,
                       core::sha256_hex(bytes.substr(kHeader + length)));
}

}  // namespace

void parse(const std::string& bytes) {
  (void)perception::read_weights(in_file(with_hash(bytes), "w.weights"));
}

std::vector<std::string> seeds() {
  perception::DetectorWeights weights;
  weights.class_names = {"chair", "couch"};
  weights.training = R"({"recipe":"test"})";
  weights.tensors = {{"stem.weight", {2, 3}, {1, 2, 3, 4, 5, 6}}, {"stem.bias", {2}, {1, 2}}};
  std::vector<std::string> all;
  for (const char* architecture :
       {perception::DetectorWeights::kArchitecture, perception::DetectorWeights::kCenterNet}) {
    weights.architecture = architecture;
    all.push_back(
        written([&](const auto& file) { perception::write_weights(file, weights); }));
  }
  return all;
}

}  // namespace segsim::fuzz
