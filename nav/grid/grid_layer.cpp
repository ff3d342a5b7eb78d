#include "nav/grid/grid_layer.h"

#include <map>
#include <mutex>
#include <new>
#include <vector>

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

namespace segsim::nav::internal {
namespace {

constexpr std::size_t kPage = 4096;
constexpr std::size_t kKept = std::size_t{256} << 20;  // Bytes that wait in the pool at most.

/// Makes a block zeros again: writes to the pages that somebody wrote to, and only to those.
/// @return  Bytes that the block now holds; nullopt if the system does not tell.
std::optional<std::size_t> wipe(void* data, std::size_t bytes) {
  static const int pagemap = open("/proc/self/pagemap", O_RDONLY | O_CLOEXEC);
  if (pagemap < 0 || sysconf(_SC_PAGESIZE) != static_cast<long>(kPage)) return std::nullopt;
  thread_local std::vector<std::uint64_t> entries;
  entries.resize(bytes / kPage);
  const auto first = reinterpret_cast<std::uintptr_t>(data) / kPage;
  const auto wanted = static_cast<ssize_t>(entries.size() * sizeof(entries[0]));
  if (pread(pagemap, entries.data(), static_cast<std::size_t>(wanted),
            static_cast<off_t>(first * sizeof(entries[0]))) != wanted) {
    return std::nullopt;
  }
  std::size_t held = 0;
  for (std::size_t k = 0; k < entries.size(); ++k) {
    if (entries[k] >> 62 == 0) continue;  // Neither in memory nor swapped out.
    std::memset(static_cast<unsigned char*>(data) + k * kPage, 0, kPage);
    held += kPage;
  }
  return held;
}

/// Blocks of zeros that were used before: their pages are there, and taking a page from the
/// system costs ten times as much as wiping it.
class Pool {
 public:
  /// The smallest block that is large enough, but not by far; nullptr if there is none.
  void* take(std::size_t& bytes) {
    const std::lock_guard lock(mutex_);
    const auto found = blocks_.lower_bound(bytes);
    if (found == blocks_.end() || found->first > 2 * bytes) return nullptr;
    const Block block = found->second;
    bytes = found->first;
    held_ -= block.held;
    blocks_.erase(found);
    return block.data;
  }
  void give(void* data, std::size_t bytes) {
    const std::optional<std::size_t> held = wipe(data, bytes);
    const std::lock_guard lock(mutex_);
    if (!held || held_ + *held > kKept) {
      munmap(data, bytes);
      return;
    }
    blocks_.emplace(bytes, Block{data, *held});
    held_ += *held;
  }

 private:
  struct Block {
    void* data;
    std::size_t held;
  };
  std::mutex mutex_;
  std::multimap<std::size_t, Block> blocks_;
  std::size_t held_ = 0;
};

Pool& pool() {
  static Pool& pool = *new Pool;  // Outlives every map.
  return pool;
}

}  // namespace

ZeroPages::ZeroPages(std::size_t size)
    : bytes(std::max(size + kPage - 1, kPage) / kPage * kPage) {
  data = pool().take(bytes);
  if (data != nullptr) return;
  data = mmap(nullptr, bytes, PROT_READ | PROT_WRITE,
              MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (data == MAP_FAILED) throw std::bad_alloc();
  // A map touches a few cells of each row: large pages would be zeros for the most part.
  madvise(data, bytes, MADV_NOHUGEPAGE);
}

ZeroPages::~ZeroPages() { pool().give(data, bytes); }

}  // namespace segsim::nav::internal
