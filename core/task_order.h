#pragma once

/// @file
/// The order between tasks of a library that ThreadSanitizer cannot see into.

namespace segsim::core {

#if defined(__SANITIZE_THREAD__)
extern "C" void __tsan_acquire(void* address);
extern "C" void __tsan_release(void* address);
#endif

/// Distribution packages of oneTBB are not instrumented, so ThreadSanitizer misses that tasks
/// begin after what came before the loop, and end before what comes after it, and reports
/// races that are none. This states just that order: races between tasks are still found.
/// Without ThreadSanitizer it is nothing.
///
///     TaskOrder order;               // before the loop
///     ... { TaskOrder::Task scope(order); body(i); } ...
///     order.wait();                  // after the loop
class TaskOrder {
 public:
  TaskOrder() { release(begun_); }
  void wait() { acquire(ended_); }

  class Task {
   public:
    explicit Task(TaskOrder& order) : order_(order) { acquire(order_.begun_); }
    ~Task() { release(order_.ended_); }
    Task(const Task&) = delete;
    Task& operator=(const Task&) = delete;

   private:
    TaskOrder& order_;
  };

 private:
#if defined(__SANITIZE_THREAD__)
  static void acquire(char& address) { __tsan_acquire(&address); }
  static void release(char& address) { __tsan_release(&address); }
#else
  static void acquire(char&) {}
  static void release(char&) {}
#endif
  char begun_ = 0, ended_ = 0;
};

}  // namespace segsim::core
