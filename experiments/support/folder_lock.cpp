#include "experiments/support/folder_lock.h"

#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <thread>

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include "core/error.h"
#include "experiments/support/stop_signal.h"

namespace segsim::experiments::support {

namespace fs = std::filesystem;

FolderLock::FolderLock(const fs::path& folder, Kind kind, IfTaken if_taken) {
  std::error_code error;
  fs::create_directories(folder, error);
  const fs::path file = folder / ".lock";
  descriptor_ = open(file.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0644);
  if (descriptor_ < 0) {
    throw core::InputError::expected(folder.string(), "a folder that can be written to",
                                     error ? error.message() : std::strerror(errno));
  }
  const int operation = kind == Kind::kExclusive ? LOCK_EX : LOCK_SH;
  if (flock(descriptor_, operation | LOCK_NB) == 0) return;
  if (if_taken == IfTaken::kRefuse) {
    close(descriptor_);
    throw core::InputError::expected(folder.string(), "a work folder of its own",
                                     "another segsim run at work there");
  }
  std::fprintf(stderr, "segsim: waiting for the process at work in %s\n", folder.c_str());
  // Asked again and again: a wait in flock() would not see a signal to stop.
  constexpr auto kPause = std::chrono::milliseconds(100);
  while (flock(descriptor_, operation | LOCK_NB) != 0) {
    const int code = errno;
    if (code == EWOULDBLOCK && !StopOnSignal::requested()) {
      std::this_thread::sleep_for(kPause);
    } else if (code != EINTR) {
      close(descriptor_);
      StopOnSignal::check();
      throw core::InputError::expected(folder.string(), "a file system with locks",
                                       std::strerror(code));
    }
  }
}

FolderLock::~FolderLock() { close(descriptor_); }

void FolderLock::share() { flock(descriptor_, LOCK_SH); }

}  // namespace segsim::experiments::support
