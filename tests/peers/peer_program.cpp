// A program for the tests to ask: peer_program
// policy|idle|detector|blink|crash|abort|hang|print|wrong|deep|throw|early
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <limits>
#include <stdexcept>
#include <string>
#include <thread>

#include "core/error.h"
#include "peers/serve.h"
#include "tests/peers/summing_stages.h"

using namespace segsim;

namespace {

/// Ends at its second image.
class BlinkingDetector final : public core::Detector {
 public:
  [[nodiscard]] const std::vector<std::string>& class_names() const override {
    return all_.class_names();
  }
  std::vector<core::Detection> detect(const core::Observation& seen) override {
    if (++images_ == 2) std::_Exit(5);
    return all_.detect(seen);
  }

 private:
  tests::SummingDetector all_;
  int images_ = 0;
};

/// Does at its second decision what the word says.
class BadPolicy final : public core::Policy {
 public:
  BadPolicy(std::string word, peers::Channel& raw) : word_(std::move(word)), raw_(&raw) {}
  void reset(const core::ObjectGoal& /*goal*/, std::uint64_t /*seed*/) override {}
  core::Decision decide(const core::Observation& /*seen*/,
                        std::span<const core::Detection> /*detections*/) override {
    if (++decisions_ < 2 || word_ == "idle") return {};
    if (word_ == "crash") std::exit(7);
    if (word_ == "abort") std::abort();
    if (word_ == "hang") std::this_thread::sleep_for(std::chrono::hours(1));
    if (word_ == "deep") {  // Nobody else writes such a message, so it is written here.
      std::string text = R"({"type":"decision","turn_radps":)" + std::string(200'000, '[');
      text += std::string(200'000, ']') + "}";
      raw_->send(text);
      std::this_thread::sleep_for(std::chrono::hours(1));
    }
    if (word_ == "throw") throw std::runtime_error("the map is full");
    core::Decision decision;
    decision.command.turn_radps = std::numeric_limits<double>::infinity();
    return decision;
  }
  [[nodiscard]] core::PolicyView view() const override { return {}; }

 private:
  std::string word_;
  peers::Channel* raw_;
  int decisions_ = 0;
};

}  // namespace

int main(int argc, char** argv) try {
  const std::string word = argc > 1 ? argv[1] : "policy";
  if (word == "early") return 3;
  if (word == "print") {
    std::puts("a line that a program prints without thinking");
    std::fflush(stdout);
    std::this_thread::sleep_for(std::chrono::hours(1));
  }
  peers::Channel channel = peers::standard_streams();
  std::puts("this goes to standard error");
  if (word == "detector") {
    tests::SummingDetector detector;
    peers::serve_detector(channel, detector);
  } else if (word == "blink") {
    BlinkingDetector detector;
    peers::serve_detector(channel, detector);
  } else {
    peers::serve_policy(channel,
                        [&](const peers::EpisodeStart&) -> std::unique_ptr<core::Policy> {
                          if (word == "policy")
                            return std::make_unique<tests::SummingPolicy>();
                          return std::make_unique<BadPolicy>(word, channel);
                        });
  }
  return 0;
} catch (const core::InputError& error) {
  std::cerr << error.what() << '\n';
  return 2;
}
