#include "peers/serve.h"

#include <exception>
#include <optional>
#include <string>
#include <vector>

#include <fcntl.h>
#include <unistd.h>

#include "core/error.h"
#include "peers/internal/messages.h"
#include "peers/shared_images.h"

namespace segsim::peers {
namespace {

using internal::Fields;
using internal::Json;

/// The observation of a message, with its images.
class ReceivedObservation {
 public:
  const core::Observation& read(const Fields& message) {
    ImagePlaces places;
    observation_ = internal::read_observation(message, places);
    reader_.get(places, rgb_, depth_m_);
    observation_.rgb = rgb_.empty() ? nullptr : &rgb_;
    observation_.depth_m = depth_m_.empty() ? nullptr : &depth_m_;
    return observation_;
  }

 private:
  SharedImageReader reader_;
  core::Image<core::Rgb8> rgb_;
  core::Image<float> depth_m_;
  core::Observation observation_;
};

/// Answers every message by `answer`, the first one by `ready`.
template <class Answer>
void serve(Channel& channel, const std::string& role, const Json& ready,
           const Answer& answer) {
  bool greeted = false;
  while (const std::optional<std::string> text = channel.receive()) {
    const Json message = internal::parse_message(*text, "the simulator");
    const Fields fields(message, "the simulator");
    const std::string type = fields.text("type");
    if (!greeted) {
      if (type != "hello") fields.fail("type", "\"hello\"");
      if (fields.text("schema") != internal::kSchema) fields.fail("schema", internal::kSchema);
      if (fields.text("role") != role) fields.fail("role", role);
      greeted = true;
      channel.send(ready.dump());
      continue;
    }
    Json reply;
    try {
      reply = answer(type, fields);
    } catch (const std::exception& error) {
      reply = {{"type", "error"}, {"message", error.what()}};
    }
    channel.send(internal::to_text(reply));
  }
}

}  // namespace

void serve_policy(Channel& channel, const MakeServedPolicy& make) {
  ReceivedObservation received;
  std::unique_ptr<core::Policy> policy;
  int classes = 0;
  serve(channel, "policy", {{"type", "ready"}},
        [&](const std::string& type, const Fields& fields) -> Json {
          if (type == "reset") {
            const EpisodeStart start = internal::read_start(fields);
            classes = static_cast<int>(start.class_names.size());
            policy = make(start);
            policy->reset(start.goal, start.seed);
            return {{"type", "ok"}};
          }
          if (type != "decide" || policy == nullptr) fields.fail("type", "reset, then decide");
          const core::Decision decision = policy->decide(
              received.read(fields), internal::read_detections(fields, classes));
          return internal::to_json(decision, policy->view());
        });
}

void serve_detector(Channel& channel, core::Detector& detector) {
  ReceivedObservation received;
  serve(channel, "detector", {{"type", "ready"}, {"class_names", detector.class_names()}},
        [&](const std::string& type, const Fields& fields) -> Json {
          if (type != "detect") fields.fail("type", "detect");
          return {{"type", "detections"},
                  {"detections", internal::to_json(detector.detect(received.read(fields)))}};
        });
}

Channel standard_streams() {
  const int output = ::fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 3);
  if (output < 0 || ::dup2(STDERR_FILENO, STDOUT_FILENO) < 0) {
    throw core::InputError("standard output: expected an open stream, found none");
  }
  return {STDIN_FILENO, output, "the simulator"};
}

}  // namespace segsim::peers
