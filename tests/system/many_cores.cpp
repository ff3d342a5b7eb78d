// Preloaded, tells a program and its libraries that the machine has 16 cores, whatever it has.
#include <dlfcn.h>
#include <pthread.h>
#include <sched.h>
#include <sys/sysinfo.h>
#include <unistd.h>

#include <cstddef>

namespace {

constexpr int kCores = 16;

void fill(std::size_t bytes, cpu_set_t* set) {
  CPU_ZERO_S(bytes, set);
  for (std::size_t core = 0; core < kCores; ++core) CPU_SET_S(core, bytes, set);
}

}  // namespace

extern "C" {

int get_nprocs() noexcept { return kCores; }
int get_nprocs_conf() noexcept { return kCores; }

long sysconf(int name) noexcept {
  if (name == _SC_NPROCESSORS_ONLN || name == _SC_NPROCESSORS_CONF) return kCores;
  static const auto next = reinterpret_cast<long (*)(int)>(dlsym(RTLD_NEXT, "sysconf"));
  return next(name);
}

int sched_getaffinity(pid_t, std::size_t bytes, cpu_set_t* set) noexcept {
  fill(bytes, set);
  return 0;
}

int pthread_getaffinity_np(pthread_t, std::size_t bytes, cpu_set_t* set) noexcept {
  fill(bytes, set);
  return 0;
}

}  // extern "C"
