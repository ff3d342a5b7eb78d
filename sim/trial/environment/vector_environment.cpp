#include "sim/trial/environment/vector_environment.h"

#include <algorithm>

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/partitioner.h>
#include <oneapi/tbb/task_arena.h>

#include "core/check.h"
#include "core/task_order.h"

namespace segsim::sim {

/// One renderer for each thread: a renderer serves one call at a time.
struct VectorEnvironment::Workers {
  explicit Workers(int threads) : arena(threads) {}
  tbb::task_arena arena;
  std::vector<std::unique_ptr<core::Renderer>> renderers;
};

VectorEnvironment::VectorEnvironment(const EpisodePool& pool,
                                     const EnvironmentOptions& options, const Size& size,
                                     EpisodeOrder::Kind order, const MakeRenderer& renderer)
    : pool_(pool), episode_of_(size.environments, 0) {
  SEGSIM_CHECK(size.environments > 0 && size.threads > 0, "environments and threads");
  for (std::size_t i = 0; i < size.environments; ++i) {
    environments_.emplace_back(pool.world(), options);
    orders_.emplace_back(order, pool.size(), i, size.environments);
  }
  const int workers =
      static_cast<int>(std::min(size.environments, static_cast<std::size_t>(size.threads)));
  workers_ = std::make_unique<Workers>(workers);
  for (int k = 0; k < workers; ++k) {
    workers_->renderers.push_back(renderer(size.threads / workers));
  }
}

VectorEnvironment::~VectorEnvironment() = default;

void VectorEnvironment::for_each(
    const std::function<void(std::size_t index, core::Renderer&)>& work) {
  const std::size_t count = environments_.size();
  if (workers_->renderers.size() == 1) {
    for (std::size_t i = 0; i < count; ++i) work(i, *workers_->renderers[0]);
    return;
  }
  core::TaskOrder order;
  workers_->arena.execute([&] {
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, count, 1),
        [&](const tbb::blocked_range<std::size_t>& range) {
          const core::TaskOrder::Task task(order);
          const auto thread =
              static_cast<std::size_t>(tbb::this_task_arena::current_thread_index());
          core::Renderer& renderer = *workers_->renderers[thread];
          // A thread that waits for its own drawing shall not begin with another environment.
          tbb::this_task_arena::isolate([&] {
            for (std::size_t i = range.begin(); i < range.end(); ++i) work(i, renderer);
          });
        },
        tbb::simple_partitioner{});
  });
  order.wait();
}

void VectorEnvironment::begin(std::size_t index, std::size_t episode,
                              core::Renderer& renderer) {
  episode_of_[index] = episode;
  environments_[index].reset(pool_.episode(episode), pool_.to_goal(episode), renderer);
}

void VectorEnvironment::reset(std::span<const Reset> resets, const Observe& observe) {
  SEGSIM_CHECK(resets.size() == size(), "one reset for each environment");
  for_each([&](std::size_t i, core::Renderer& renderer) {
    if (resets[i].restart) orders_[i].restart(resets[i].seed);
    const std::size_t episode = resets[i].episode < 0
                                    ? orders_[i].next()
                                    : static_cast<std::size_t>(resets[i].episode);
    begin(i, episode, renderer);
    observe(i, environments_[i]);
  });
}

std::vector<VectorEnvironment::Step> VectorEnvironment::step(
    std::span<const EnvironmentAction> actions, const Observe& observe) {
  SEGSIM_CHECK(actions.size() == size(), "one action for each environment");
  std::vector<Step> steps(size());
  for_each([&](std::size_t i, core::Renderer& renderer) {
    if (environments_[i].over()) {
      begin(i, orders_[i].next(), renderer);
      steps[i].reset = true;
    } else {
      steps[i].step = environments_[i].step(actions[i], renderer);
    }
    observe(i, environments_[i]);
  });
  return steps;
}

}  // namespace segsim::sim
