#pragma once

/// @file
/// Keeps processes out of one another's folders.

#include <filesystem>

namespace segsim::experiments::support {

/// flock() on a file in a folder: released when the process ends, however it does. Holds over
/// machines where the file system does (NFS 4, Lustre with -o flock, Ceph).
class FolderLock {
 public:
  enum class Kind { kExclusive, kShared };
  enum class IfTaken { kRefuse, kWait };

  /// @param folder  Is made if it is missing.
  /// @throws core::InputError if it cannot be written to, or is taken and `if_taken` says so;
  ///         core::Interrupted if a signal to stop comes while it waits (stop_signal.h).
  FolderLock(const std::filesystem::path& folder, Kind kind, IfTaken if_taken);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

  /// From exclusive to shared.
  void share();

 private:
  int descriptor_ = -1;
};

}  // namespace segsim::experiments::support
