// A policy and a detector in another process: the same answers to the bit, and every way in
// which such a program can fail.
#include <cmath>
#include <memory>
#include <string>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>

#include "core/config.h"
#include "core/random.h"
#include "peers/peer.h"
#include "peers/serve.h"
#include "tests/error_message.h"
#include "tests/peers/summing_stages.h"
#include "tests/temporary_folder.h"

namespace segsim::peers {
namespace {

using testing::HasSubstr;
using tests::input_error_of;

core::PeerCommand started(std::vector<std::string> words) {
  core::PeerCommand command;
  command.command = std::move(words);
  command.start_s = command.answer_s = 20.0;
  return command;
}

core::PeerCommand program(const std::string& word) { return started({PEER_PROGRAM, word}); }

core::PeerCommand listener(const std::filesystem::path& socket) {
  core::PeerCommand command;
  command.socket = socket;
  return command;
}

std::shared_ptr<Peer> policy_of(const std::string& word) {
  return std::make_shared<Peer>(program(word), "policy");
}

EpisodeStart some_start() {
  EpisodeStart start;
  start.class_names = {"chair", "couch"};
  start.robot.length_m = 0.508;
  start.robot.max_forward_mps = 1.0 / 3.0;
  start.camera_height_m = 1.2;
  return start;
}

/// An observation with images of its own.
struct Seen {
  core::Image<core::Rgb8> rgb;
  core::Image<float> depth_m;
  core::Observation observation;

  Seen(int width_px, int height_px, std::uint64_t seed)
      : rgb(width_px, height_px), depth_m(width_px, height_px) {
    core::RandomStream random(seed, "images");
    for (core::Rgb8& p : rgb.pixels()) {
      p = {static_cast<std::uint8_t>(random.uniform() * 255.0),
           static_cast<std::uint8_t>(random.uniform() * 255.0), 7};
    }
    for (float& d : depth_m.pixels()) {
      const double u = random.uniform();
      d = u < 0.1 ? std::nanf("") : static_cast<float>(6.0 * u);
    }
    observation.capture_time_ns = 200'000'000 * static_cast<std::int64_t>(seed);
    observation.capture_index = seed;
    observation.intrinsics = core::CameraIntrinsics::from_fov(width_px, height_px, 1.3);
    observation.T_odom_robot = core::transform_from_pose2<core::frame::Odom>(
        core::Pose2{1.0 / 3.0, random.uniform(), 0.1});
    observation.T_robot_camera = core::mast_camera(1.2, 0.14);
    observation.rgb = &rgb;
    observation.depth_m = &depth_m;
  }
};

const std::vector<core::Detection> kFound{{1, 0.9F, {1.1F, 2.2F, 3.3F, 4.4F}},
                                          {0, 0.1F, {0, 0, 5, 6}}};

TEST(Peer, APolicyElsewhereAnswersToTheBit) {
  const std::unique_ptr<core::Policy> there =
      make_peer_policy(policy_of("policy"), some_start());
  tests::SummingPolicy here;
  for (std::uint64_t episode = 0; episode < 2; ++episode) {
    const core::ObjectGoal goal{"couch", 1, episode == 0 ? "" : "a red couch"};
    there->reset(goal, 18446744073709551615ULL - episode);
    here.reset(goal, 18446744073709551615ULL - episode);
    for (std::uint64_t k = 1; k <= 3; ++k) {
      // The images grow, which asks for memory anew.
      const Seen seen(20 + 30 * static_cast<int>(k), 15, k);
      const core::Decision a = there->decide(seen.observation, kFound);
      const core::Decision b = here.decide(seen.observation, kFound);
      EXPECT_EQ(a.command.forward_mps, b.command.forward_mps);
      EXPECT_EQ(a.command.turn_radps, b.command.turn_radps);
      EXPECT_EQ(a.mode, b.mode);
      EXPECT_EQ(a.stop, b.stop);
      EXPECT_EQ(there->view().path_m, here.view().path_m);
      EXPECT_EQ(there->view().target_m, here.view().target_m);
    }
  }
}

TEST(Peer, WithoutImagesTooAndWithoutDetections) {
  const std::unique_ptr<core::Policy> there =
      make_peer_policy(policy_of("policy"), some_start());
  tests::SummingPolicy here;
  there->reset({"couch", -1}, 1);
  here.reset({"couch", -1}, 1);
  Seen seen(8, 6, 1);
  seen.observation.rgb = nullptr;
  EXPECT_EQ(there->decide(seen.observation, {}).command.turn_radps,
            here.decide(seen.observation, {}).command.turn_radps);
}

TEST(Peer, ADetectorElsewhereNamesItsClassesAndDetects) {
  const auto peer = std::make_shared<Peer>(program("detector"), "detector");
  const std::unique_ptr<core::Detector> there = make_peer_detector(peer);
  tests::SummingDetector here;
  EXPECT_EQ(there->class_names(), here.class_names());
  const Seen seen(64, 48, 5);
  const std::vector<core::Detection> a = there->detect(seen.observation);
  const std::vector<core::Detection> b = here.detect(seen.observation);
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t k = 0; k < a.size(); ++k) {
    EXPECT_EQ(a[k].class_index, b[k].class_index);
    EXPECT_EQ(a[k].score, b[k].score);
    EXPECT_EQ(a[k].box.x0, b[k].box.x0);
    EXPECT_EQ(a[k].box.y1, b[k].box.y1);
  }
}

TEST(Peer, ADetectorThatEndsBeginsAnewAtTheNextImage) {
  const std::unique_ptr<core::Detector> detector =
      make_peer_detector(std::make_shared<Peer>(program("blink"), "detector"));
  const Seen seen(64, 48, 5);
  for (int trial = 0; trial < 2; ++trial) {
    EXPECT_EQ(detector->detect(seen.observation).size(), 2U);
    EXPECT_THAT(input_error_of([&] { (void)detector->detect(seen.observation); }),
                HasSubstr("found that it ended with exit code 5"));
  }
}

/// What the second decision of a program complains about; the first one works.
std::string complaint_of(const std::string& word, double answer_s = 20.0) {
  core::PeerCommand command = program(word);
  command.answer_s = answer_s;
  const auto peer = std::make_shared<Peer>(command, "policy");
  const std::unique_ptr<core::Policy> policy = make_peer_policy(peer, some_start());
  const Seen seen(8, 6, 1);
  std::string complaint;
  for (int again = 0; again < 2; ++again) {  // It begins anew.
    policy->reset({"couch", 1}, 1);
    (void)policy->decide(seen.observation, kFound);
    complaint = input_error_of([&] { (void)policy->decide(seen.observation, kFound); });
  }
  return complaint;
}

TEST(Peer, AFailureNamesTheProgramAndItsCause) {
  EXPECT_THAT(complaint_of("crash"), HasSubstr("crash\": expected an answer to \"decide\", "
                                               "found that it ended with exit code 7"));
  EXPECT_THAT(complaint_of("abort"), HasSubstr("found that it was ended by signal 6"));
  EXPECT_THAT(complaint_of("hang", 0.3),
              HasSubstr("expected an answer to \"decide\" within 0.3 s, found none"));
  EXPECT_THAT(complaint_of("deep"),
              HasSubstr("turn_radps: expected a finite number, found array"));
  EXPECT_THAT(complaint_of("throw"), HasSubstr("throw\": the map is full"));
  // JSON has no infinity.
  EXPECT_THAT(complaint_of("wrong"), HasSubstr("turn_radps: expected a finite number"));
}

TEST(Peer, AProgramThatCannotBeginIsTold) {
  const auto complaint = [](core::PeerCommand command, const char* role) {
    return input_error_of([&] { Peer(std::move(command), role).start(); });
  };
  EXPECT_THAT(complaint(started({"/no/such/program"}), "policy"),
              HasSubstr("/no/such/program: expected a program that can be started"));
  EXPECT_THAT(complaint(program("early"), "policy"), HasSubstr("it ended with exit code 3"));
  EXPECT_THAT(complaint(program("print"), "policy"),
              HasSubstr("is something printed to the same stream?"));
  EXPECT_THAT(complaint(program("detector"), "policy"), HasSubstr("exit code 2"));
  EXPECT_THAT(complaint(listener("/no/such.sock"), "policy"),
              HasSubstr("/no/such.sock: expected a socket on which a program listens"));
  EXPECT_THAT(complaint(listener(std::string(200, 'x')), "policy"),
              HasSubstr("expected a path shorter than"));
}

TEST(Peer, AProgramThatListensIsConnectedTo) {
  const tests::TemporaryFolder folder("segsim_peer");
  const std::filesystem::path path = folder.path() / "policy.sock";
  const OwnedFd listening(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_un address = {};
  address.sun_family = AF_UNIX;
  path.string().copy(address.sun_path, sizeof(address.sun_path) - 1);
  ASSERT_EQ(
      ::bind(listening.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)),
      0);
  ASSERT_EQ(::listen(listening.get(), 1), 0);
  std::thread server([&] {
    Channel channel(OwnedFd(::accept(listening.get(), nullptr, nullptr)), "the simulator");
    serve_policy(channel,
                 [](const EpisodeStart&) { return std::make_unique<tests::SummingPolicy>(); });
  });
  {
    const std::unique_ptr<core::Policy> there =
        make_peer_policy(std::make_shared<Peer>(listener(path), "policy"), some_start());
    tests::SummingPolicy here;
    there->reset({"couch", 1}, 1);
    here.reset({"couch", 1}, 1);
    const Seen seen(8, 6, 1);
    EXPECT_EQ(there->decide(seen.observation, kFound).command.turn_radps,
              here.decide(seen.observation, kFound).command.turn_radps);
  }
  server.join();
}

TEST(PeerCommand, IsReadFromASpec) {
  const auto read = [](const std::string& text) {
    return core::read_peer_command(
        core::ConfigNode::parse(text, "spec.yaml"),
        [](const core::ConfigNode&) { return std::filesystem::path("/specs/mine.py"); });
  };
  const core::PeerCommand peer =
      read("{command: [python3, '${spec}/mine.py', --fast], answer_s: 0.5}");
  EXPECT_EQ(peer.in_words(), "python3 /specs/mine.py --fast");
  EXPECT_EQ(peer.answer_s, 0.5);
  EXPECT_EQ(peer.start_s, 60.0);
  const auto complaint = [&](const std::string& text) {
    return input_error_of([&] { (void)read(text); });
  };
  EXPECT_THAT(complaint("{}"), HasSubstr("one of `command"));
  EXPECT_THAT(complaint("{command: [a], socket: b}"), HasSubstr("found several"));
  EXPECT_EQ(read("{python: 'my.module:Mine'}").in_words(), "python:my.module:Mine");
  EXPECT_THAT(complaint("{python: mine}"), HasSubstr("expected MODULE:CLASS"));
  EXPECT_THAT(complaint("{command: []}"), HasSubstr("a program and its arguments"));
  EXPECT_THAT(complaint("{command: [a], answer_s: 0}"), HasSubstr("spec.yaml:1: answer_s"));
}

}  // namespace
}  // namespace segsim::peers
