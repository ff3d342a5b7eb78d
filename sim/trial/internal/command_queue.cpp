#include "sim/trial/internal/command_queue.h"

namespace segsim::sim::internal {
namespace {

using Kind = BaseOrder::Kind;

/// What a rule makes of a command.
BaseOrder order_by(OnMiss rule, const core::VelocityCommand& command) {
  switch (rule) {
    case OnMiss::kUseStale:
      return {Kind::kDrive, command, {}};
    case OnMiss::kDrop:
      return {};
    case OnMiss::kHold:
      return {Kind::kSendAgain, {}, {}};
    case OnMiss::kZeroCommand:
      return {Kind::kDrive, {}, {}};
    case OnMiss::kAbort:
      return {Kind::kAbort, {}, {}};
  }
  return {};
}

}  // namespace

CommandQueue::CommandQueue(const LatencyBudget& budget)
    : on_miss_(budget.on_miss),
      on_max_age_(budget.on_max_age),
      max_age_ns_(budget.max_age_ns) {
  end_to_end_.name = "end_to_end";
  end_to_end_.deadline_ns = budget.end_to_end_deadline_ns;
}

bool CommandQueue::too_old(core::TimeNs age_ns) const {
  return max_age_ns_ > 0 && age_ns > max_age_ns_ && on_max_age_ != OnMiss::kUseStale;
}

bool CommandQueue::refuses(core::TimeNs image_age_ns) {
  const core::TimeNs deadline_ns = end_to_end_.deadline_ns;
  if (on_miss_ != OnMiss::kDrop || deadline_ns == 0 || image_age_ns <= deadline_ns) {
    return false;
  }
  end_to_end_.add(image_age_ns);  // At least that late.
  sends_again_ = false;
  return true;
}

void CommandQueue::send(std::uint64_t tick, const core::Decision& decision,
                        core::TimeNs capture_ns, core::TimeNs now_ns) {
  sends_again_ = true;
  // Known here already: a command that takes no time arrives before check_age() is asked.
  sent_[tick] = {decision.command, capture_ns, decision.stop, too_old(now_ns - capture_ns)};
}

BaseOrder CommandQueue::arrive(std::uint64_t tick, core::TimeNs time_ns) {
  const Sent sent = sent_.at(tick);
  sent_.erase(tick);
  const bool late = end_to_end_.add(time_ns - sent.capture_ns);
  if (sent.stop) return {Kind::kStop, {}, sent.stop};
  // An actuation delay that varies may let a newer command overtake.
  if (tick < newest_arrived_) return {};
  newest_arrived_ = tick;
  if (sent.too_old) return {};  // The rule on the age has answered in its place.
  return order_by(late ? on_miss_ : OnMiss::kUseStale, sent.command);
}

BaseOrder CommandQueue::check_age(core::TimeNs age_ns) {
  if (!too_old(age_ns)) return {};
  sends_again_ = on_max_age_ == OnMiss::kHold;
  for (auto& [tick, sent] : sent_) sent.too_old = true;
  return order_by(on_max_age_, {});
}

BaseOrder CommandQueue::repeat() const {
  return {sends_again_ ? Kind::kSendAgain : Kind::kNothing, {}, {}};
}

}  // namespace segsim::sim::internal
