#include "experiments/support/side_by_side.h"

#include <algorithm>
#include <thread>

#include "experiments/support/task_graph.h"

namespace segsim::experiments::support {

int processor_count() {
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

void side_by_side(std::size_t count, int at_once,
                  const std::function<void(std::size_t index)>& work) {
  TaskGraph graph;
  for (std::size_t index = 0; index < count; ++index) {
    graph.add([&work, index] { work(index); });
  }
  graph.run(at_once);
}

}  // namespace segsim::experiments::support
