#include "sim/gazebo/internal/gazebo_transport.h"

#include <cstdlib>
#include <utility>

namespace segsim::sim::internal {
namespace {

/// The transport reads its environment once, when the first node is made.
void prepare_environment() {
  for (const auto& [newer, older] :
       {std::pair("GZ_PARTITION", "IGN_PARTITION"), std::pair("GZ_IP", "IGN_IP")}) {
    if (const char* value = std::getenv(newer)) ::setenv(older, value, 0);
  }
  ::setenv("IGN_TRANSPORT_SNDHWM", std::to_string(kSendQueue).c_str(), 0);
}

}  // namespace

std::vector<std::unique_ptr<Dialect>> make_dialects(GazeboFlavour flavour) {
  prepare_environment();
  std::vector<std::unique_ptr<Dialect>> dialects;
  const auto add = [&](const char* prefix) {
    dialects.push_back(std::make_unique<Dialect>());
    dialects.back()->prefix = prefix;
  };
  if (flavour != GazeboFlavour::kGz) add("ignition.msgs.");
  if (flavour != GazeboFlavour::kIgnition) add("gz.msgs.");
  return dialects;
}

bool PoseMessage::read(const char* bytes, std::size_t size) {
  entities_.clear();
  if (!message_.ParseFromArray(bytes, static_cast<int>(size))) return false;
  for (const ignition::msgs::Pose& pose : message_.pose()) {
    const auto& p = pose.position();
    const auto& q = pose.orientation();
    entities_.push_back(
        {pose.name(), pose.id(), {p.x(), p.y(), p.z()}, {q.w(), q.x(), q.y(), q.z()}});
  }
  return true;
}

std::optional<core::TimeNs> PoseMessage::stamp_ns() const {
  if (!message_.has_header() || !message_.header().has_stamp()) return {};
  const auto& stamp = message_.header().stamp();
  constexpr std::int64_t kLongestTime_s = 1'000'000'000;  // 31 years: no int64 overflows.
  if (stamp.sec() < 0 || stamp.sec() > kLongestTime_s || stamp.nsec() < 0 ||
      stamp.nsec() >= core::kNsPerSecond) {
    return {};
  }
  return stamp.sec() * core::kNsPerSecond + stamp.nsec();
}

}  // namespace segsim::sim::internal
