// A target of tests/fuzz/targets without libFuzzer, in every build:
//
//     TARGET FILE|FOLDER...   gives every file to the parser; those named *.hex are bytes as
//                             hexadecimal digits
//     TARGET --seeds FOLDER   writes the seeds
//
// Its seeds and a fixed number of damaged copies of each come first. Exit code 0 if the parser
// took every seed, and took or refused the rest.

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/random.h"
#include "tests/fuzz/fuzz_target.h"

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv);

namespace segsim::fuzz {
namespace {

namespace fs = std::filesystem;

constexpr int kCopies = 10;  // Of each seed.

std::string from_hex(const std::string& text) {
  std::string bytes, digits;
  for (const char c : text) {
    if (std::strchr("0123456789abcdef", c) == nullptr || c == '\0') continue;
    digits += c;
    if (digits.size() < 2) continue;
    bytes += static_cast<char>(std::stoi(digits, nullptr, 16));
    digits.clear();
  }
  return bytes;
}

std::vector<fs::path> files_of(const fs::path& place) {
  if (!fs::is_directory(place)) return {place};
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(place)) {
    if (entry.is_regular_file()) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

/// One fault: a byte changed, bytes cut out or doubled, or the end missing.
std::string damaged(std::string bytes, core::RandomStream& random) {
  if (bytes.empty()) return bytes;
  const std::size_t at = random.index(static_cast<std::uint32_t>(bytes.size()));
  const std::size_t count = std::size_t{1} << random.index(7);
  switch (random.index(4)) {
    case 0:
      bytes[at] = static_cast<char>(random.index(256));
      break;
    case 1:
      bytes.erase(at, count);
      break;
    case 2:
      bytes.insert(at, bytes.substr(at, count));
      break;
    default:
      bytes.resize(at);
  }
  return bytes;
}

void run_seeds() {
  core::RandomStream random(1, "damage");
  int number = 0;
  for (const std::string& seed : seeds()) {
    const Verdict verdict = run_input(seed);
    if (!verdict.taken) {
      throw std::runtime_error("seed " + std::to_string(number) +
                               " was refused: " + verdict.refusal);
    }
    for (int copy = 0; copy < kCopies; ++copy) {
      const std::string bytes = damaged(seed, random);
      std::ofstream(work_folder() / "last-input", std::ios::binary) << bytes;
      (void)run_input(bytes);
    }
    ++number;
  }
}

void run_file(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  const std::string bytes(std::istreambuf_iterator<char>(in), {});
  const Verdict verdict = run_input(file.extension() == ".hex" ? from_hex(bytes) : bytes);
  std::printf("%s: %s\n", file.c_str(),
              verdict.taken ? "taken" : ("refused: " + verdict.refusal).c_str());
}

}  // namespace
}  // namespace segsim::fuzz

int main(int argc, char** argv) {
  LLVMFuzzerInitialize(&argc, &argv);
  std::string at = "the seeds";
  try {
    segsim::fuzz::run_seeds();
    for (int i = 1; i < argc; ++i) {
      for (const std::filesystem::path& file : segsim::fuzz::files_of(argv[i])) {
        at = file.string();
        segsim::fuzz::run_file(file);
      }
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s: expected a parser that takes or refuses, found %s\n",
                 argv[0], at.c_str(), error.what());
    return 1;
  }
  return 0;
}
