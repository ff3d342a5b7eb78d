#include "peers/peer.h"

#include <utility>

#include "core/error.h"
#include "peers/internal/connection.h"
#include "peers/internal/messages.h"

namespace segsim::peers {
namespace {

using internal::Fields;
using internal::Json;

class PeerPolicy final : public core::Policy {
 public:
  PeerPolicy(std::shared_ptr<Peer> peer, EpisodeStart start)
      : peer_(std::move(peer)), start_(std::move(start)) {}

  void reset(const core::ObjectGoal& goal, std::uint64_t seed) override {
    start_.goal = goal;
    start_.seed = seed;
    view_ = {};
    peer_->reset(start_);
  }
  core::Decision decide(const core::Observation& observation,
                        std::span<const core::Detection> detections) override {
    return peer_->decide(observation, detections, view_);
  }
  [[nodiscard]] core::PolicyView view() const override { return view_; }

 private:
  std::shared_ptr<Peer> peer_;
  EpisodeStart start_;
  core::PolicyView view_;
};

class PeerDetector final : public core::Detector {
 public:
  explicit PeerDetector(std::shared_ptr<Peer> peer) : peer_(std::move(peer)) {
    peer_->start();
    class_names_ = peer_->class_names();
  }
  [[nodiscard]] const std::vector<std::string>& class_names() const override {
    return class_names_;
  }
  std::vector<core::Detection> detect(const core::Observation& observation) override {
    return peer_->detect(observation);
  }

 private:
  std::shared_ptr<Peer> peer_;
  std::vector<std::string> class_names_;
};

}  // namespace

Peer::Peer(core::PeerCommand command, std::string role, std::vector<std::string> goals)
    : command_(std::move(command)), role_(std::move(role)), goals_(std::move(goals)) {}

Peer::~Peer() = default;

void Peer::start() {
  if (connection_ != nullptr) return;
  auto connection = std::make_unique<internal::Connection>(command_, role_, goals_);
  if (role_ == "detector") {
    std::vector<std::string> names =
        Fields(connection->ready(), connection->name() + ": ready").texts("class_names");
    // Indices into the names of a first start are in use.
    if (!class_names_.empty() && names != class_names_) {
      throw core::InputError::expected(connection->name(), "the classes of its first start",
                                       "others");
    }
    if (names.empty()) {
      throw core::InputError::expected(connection->name(), "at least one class name", "none");
    }
    class_names_ = std::move(names);
  }
  connection_ = std::move(connection);
}

/// Whoever fails is ended, since nobody knows which message its next answer belongs to.
template <class Ask>
auto Peer::guarded(const Ask& ask) {
  start();
  try {
    return ask(*connection_);
  } catch (...) {
    connection_.reset();
    throw;
  }
}

void Peer::reset(const EpisodeStart& start) {
  guarded([&](internal::Connection& c) {
    return c.ask(internal::to_json(start), "ok", command_.answer_s);
  });
}

core::Decision Peer::decide(const core::Observation& observation,
                            std::span<const core::Detection> detections,
                            core::PolicyView& view) {
  return guarded([&](internal::Connection& c) {
    Json message = internal::to_json(observation, c.images().put(observation));
    message["type"] = "decide";
    message["detections"] = internal::to_json(detections);
    const Json answer = c.ask(message, "decision", command_.answer_s);
    const Fields fields(answer, c.name() + ": decision");
    view = internal::read_view(fields);
    return internal::read_decision(fields);
  });
}

std::vector<core::Detection> Peer::detect(const core::Observation& observation) {
  return guarded([&](internal::Connection& c) {
    Json message = internal::to_json(observation, c.images().put(observation));
    message["type"] = "detect";
    const Json answer = c.ask(message, "detections", command_.answer_s);
    return internal::read_detections(Fields(answer, c.name() + ": detections"),
                                     static_cast<int>(class_names_.size()));
  });
}

std::unique_ptr<core::Policy> make_peer_policy(std::shared_ptr<Peer> peer,
                                               EpisodeStart start) {
  return std::make_unique<PeerPolicy>(std::move(peer), std::move(start));
}

std::unique_ptr<core::Detector> make_peer_detector(std::shared_ptr<Peer> peer) {
  return std::make_unique<PeerDetector>(std::move(peer));
}

}  // namespace segsim::peers
