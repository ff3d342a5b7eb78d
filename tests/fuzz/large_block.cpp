// assimp's reader of OBJ files takes 16 MB for each of them. AddressSanitizer fetches such
// blocks from the system anew every time, which takes twenty times as long as reading a small
// file. One block is kept here; it is poisoned while nobody has it and behind the end of who
// has it. In turn AddressSanitizer does not see that memory of `new` goes back by `free`.
#include <sanitizer/asan_interface.h>
#include <sys/mman.h>

#include <atomic>
#include <cstdlib>
#include <new>

namespace {

constexpr std::size_t kLeast = std::size_t{16} << 20, kMost = kLeast + (std::size_t{1} << 20);

std::atomic_flag taken = ATOMIC_FLAG_INIT;

void* block() {
  static void* const kBlock = [] {
    void* place =
        mmap(nullptr, kMost, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (place == MAP_FAILED) return static_cast<void*>(nullptr);
    madvise(place, kMost, MADV_HUGEPAGE);
    return place;
  }();
  return kBlock;
}

void* take(std::size_t size) {
  if (size >= kLeast && size <= kMost && block() != nullptr && !taken.test_and_set()) {
    __asan_poison_memory_region(block(), kMost);
    __asan_unpoison_memory_region(block(), size);
    return block();
  }
  return std::malloc(size == 0 ? 1 : size);
}

void give_back(void* place) {
  if (place == nullptr || place != block()) return std::free(place);
  __asan_poison_memory_region(place, kMost);
  taken.clear();
}

void* take_or_throw(std::size_t size) {
  void* place = take(size);
  if (place == nullptr) throw std::bad_alloc();
  return place;
}

}  // namespace

void* operator new(std::size_t size) { return take_or_throw(size); }
void* operator new[](std::size_t size) { return take_or_throw(size); }
void* operator new(std::size_t size, const std::nothrow_t&) noexcept { return take(size); }
void* operator new[](std::size_t size, const std::nothrow_t&) noexcept { return take(size); }
void operator delete(void* place) noexcept { give_back(place); }
void operator delete[](void* place) noexcept { give_back(place); }
void operator delete(void* place, std::size_t) noexcept { give_back(place); }
void operator delete[](void* place, std::size_t) noexcept { give_back(place); }
void operator delete(void* place, const std::nothrow_t&) noexcept { give_back(place); }
void operator delete[](void* place, const std::nothrow_t&) noexcept { give_back(place); }
