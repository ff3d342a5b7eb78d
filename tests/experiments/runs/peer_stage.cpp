// A stage for the tests to run in a process: peer_stage frontier|crash|blind
//     frontier  the policy of that name     crash  ends at its tenth decision
//     blind     a detector of chairs and couches that sees none
#include <cstdlib>
#include <iostream>
#include <memory>
#include <string>

#include "core/error.h"
#include "nav/policies/policy_registry.h"
#include "peers/serve.h"

using namespace segsim;

namespace {

class CrashingPolicy final : public core::Policy {
 public:
  void reset(const core::ObjectGoal& /*goal*/, std::uint64_t /*seed*/) override {}
  core::Decision decide(const core::Observation& /*seen*/,
                        std::span<const core::Detection> /*detections*/) override {
    if (++decisions_ == 10) std::_Exit(9);
    return {};
  }
  [[nodiscard]] core::PolicyView view() const override { return {}; }

 private:
  int decisions_ = 0;
};

class BlindDetector final : public core::Detector {
 public:
  [[nodiscard]] const std::vector<std::string>& class_names() const override { return names_; }
  std::vector<core::Detection> detect(const core::Observation& /*seen*/) override {
    return {};
  }

 private:
  std::vector<std::string> names_{"chair", "couch"};
};

std::unique_ptr<core::Policy> make_frontier(const peers::EpisodeStart& start) {
  nav::PolicyContext context;
  context.class_names = start.class_names;
  context.robot = start.robot;
  context.camera_height_m = start.camera_height_m;
  return nav::PolicyRegistry::instance().usual("frontier").make(context);
}

}  // namespace

int main(int argc, char** argv) try {
  const std::string word = argc > 1 ? argv[1] : "";
  peers::Channel channel = peers::standard_streams();
  if (word == "blind") {
    BlindDetector detector;
    peers::serve_detector(channel, detector);
  } else if (word == "crash") {
    peers::serve_policy(channel, [](const peers::EpisodeStart&) {
      return std::make_unique<CrashingPolicy>();
    });
  } else {
    peers::serve_policy(channel, make_frontier);
  }
  return 0;
} catch (const core::InputError& error) {
  std::cerr << error.what() << '\n';
  return 2;
}
