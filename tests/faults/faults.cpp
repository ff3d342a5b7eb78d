// Preloaded, makes one call of the system fail, or that one and all that follow: a full disk,
// a broken one, no memory. fault_report.h says how it is told which.
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/sendfile.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <cerrno>
#include <climits>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "tests/faults/fault_report.h"

extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* old, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);
}

namespace {

using segsim::tests::FaultReport;
using segsim::tests::kLargeBlock;

enum Kind : unsigned {
  kWrite = 1U,
  kSync = 2U,
  kRename = 4U,
  kOpen = 8U,
  kMap = 16U,
  kMemory = 32U,
};

struct Plan {
  FaultReport* report = nullptr;  ///< Null: calls are not counted here.
  unsigned kinds = 0;
  std::uint64_t at = 0;
  bool lasting = false;
  int error = ENOSPC;
  const char* folder = "";
  std::size_t folder_length = 0;
};
Plan plan;

const char* variable(const char* name) {
  const char* text = std::getenv(name);
  return text == nullptr ? "" : text;
}

unsigned kinds_of(const char* names) {
  constexpr struct {
    const char* name;
    Kind kind;
  } kKinds[] = {{"write", kWrite}, {"sync", kSync}, {"rename", kRename},
                {"open", kOpen},   {"map", kMap},   {"memory", kMemory}};
  unsigned kinds = 0;
  for (const auto& known : kKinds) {
    if (std::strstr(names, known.name) != nullptr) kinds |= known.kind;
  }
  return kinds;
}

__attribute__((constructor)) void begin() {
  char program[PATH_MAX] = "";  // The launcher leaves its own name to what it becomes.
  if (syscall(SYS_readlink, "/proc/self/exe", program, sizeof program - 1) <= 0) return;
  const char* name = std::strrchr(program, '/');
  if (name == nullptr || std::strcmp(name + 1, variable("SEGSIM_FAULT_PROGRAM")) != 0) return;
  const long file =
      syscall(SYS_openat, AT_FDCWD, variable("SEGSIM_FAULT_REPORT"), O_RDWR | O_CLOEXEC, 0);
  if (file < 0) return;
  // Whatever the C library's mmap becomes below.
  const long place = syscall(SYS_mmap, nullptr, sizeof(FaultReport), PROT_READ | PROT_WRITE,
                             MAP_SHARED, file, 0);
  syscall(SYS_close, file);
  if (place == -1) return;
  plan.kinds = kinds_of(variable("SEGSIM_FAULT_CALLS"));
  plan.at = std::strtoull(variable("SEGSIM_FAULT_AT"), nullptr, 10);
  plan.lasting = *variable("SEGSIM_FAULT_LASTING") != '\0';
  const char* error = variable("SEGSIM_FAULT_ERROR");
  plan.error = std::strcmp(error, "EIO") == 0      ? EIO
               : std::strcmp(error, "ENOMEM") == 0 ? ENOMEM
                                                   : ENOSPC;
  plan.folder = variable("SEGSIM_FAULT_FOLDER");
  plan.folder_length = std::strlen(plan.folder);
  plan.report = reinterpret_cast<FaultReport*>(place);
}

/// Counts a call. @return  Whether it fails; errno is set then.
bool fails(const char* name, const char* file) {
  const std::uint64_t number = plan.report->calls.fetch_add(1) + 1;
  if (plan.at == 0 || number < plan.at || (number > plan.at && !plan.lasting)) return false;
  if (plan.report->failures.fetch_add(1) == 0) {
    const char* slash = std::strrchr(file, '/');
    std::snprintf(plan.report->what, sizeof plan.report->what, "%s %s", name,
                  slash == nullptr ? file : slash + 1);
  }
  errno = plan.error;
  return true;
}

bool counts(Kind kind) { return plan.report != nullptr && (plan.kinds & kind) != 0; }

bool below_folder(const char* path) {
  return std::strncmp(path, plan.folder, plan.folder_length) == 0 &&
         path[plan.folder_length] == '/';
}

/// Of names that are not absolute: they are below the folder if the working folder is.
bool fails_at_path(Kind kind, const char* name, const char* path) {
  if (!counts(kind) || path == nullptr) return false;
  char working[PATH_MAX];
  const bool below =
      *path == '/' ? below_folder(path)
                   : syscall(SYS_getcwd, working, sizeof working) > 0 && below_folder(working);
  return below && fails(name, path);
}

bool fails_at_descriptor(Kind kind, const char* name, int descriptor) {
  if (!counts(kind)) return false;
  char link[32], path[PATH_MAX];
  std::snprintf(link, sizeof link, "/proc/self/fd/%d", descriptor);
  const long length = syscall(SYS_readlink, link, path, sizeof path - 1);
  if (length <= 0) return false;
  path[length] = '\0';
  return below_folder(path) && fails(name, path);
}

bool fails_at_size(Kind kind, const char* name, std::uint64_t size) {
  return size >= kLargeBlock && counts(kind) && fails(name, "of a large block");
}

bool writes(int flags) { return (flags & O_ACCMODE) != O_RDONLY; }
bool writes(const char* mode) { return std::strpbrk(mode, "wa+") != nullptr; }

/// The function that this library stands before.
template <class Function>
Function next(Function, const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}
#define NEXT(function) static const auto next_one = next(&function, #function)

mode_t mode_of(int flags, va_list& more) {
  const bool creates = (flags & O_CREAT) != 0 || (flags & O_TMPFILE) == O_TMPFILE;
  return creates ? va_arg(more, mode_t) : 0;
}

}  // namespace

extern "C" {

#define SEGSIM_OPEN(function)                                              \
  int function(const char* path, int flags, ...) {                         \
    NEXT(function);                                                        \
    va_list more;                                                          \
    va_start(more, flags);                                                 \
    const mode_t mode = mode_of(flags, more);                              \
    va_end(more);                                                          \
    if (writes(flags) && fails_at_path(kOpen, #function, path)) return -1; \
    return next_one(path, flags, mode);                                    \
  }
SEGSIM_OPEN(open)
SEGSIM_OPEN(open64)

#define SEGSIM_OPENAT(function)                                            \
  int function(int folder, const char* path, int flags, ...) {             \
    NEXT(function);                                                        \
    va_list more;                                                          \
    va_start(more, flags);                                                 \
    const mode_t mode = mode_of(flags, more);                              \
    va_end(more);                                                          \
    if (writes(flags) && fails_at_path(kOpen, #function, path)) return -1; \
    return next_one(folder, path, flags, mode);                            \
  }
SEGSIM_OPENAT(openat)
SEGSIM_OPENAT(openat64)

#define SEGSIM_FOPEN(function)                                                 \
  FILE* function(const char* path, const char* mode) {                         \
    NEXT(function);                                                            \
    if (writes(mode) && fails_at_path(kOpen, #function, path)) return nullptr; \
    return next_one(path, mode);                                               \
  }
SEGSIM_FOPEN(fopen)
SEGSIM_FOPEN(fopen64)

/// With a descriptor as first argument.
#define SEGSIM_CALL(result, kind, function, parameters, arguments)   \
  result function parameters {                                       \
    NEXT(function);                                                  \
    if (fails_at_descriptor(kind, #function, descriptor)) return -1; \
    return next_one arguments;                                       \
  }
SEGSIM_CALL(ssize_t, kWrite, write, (int descriptor, const void* data, std::size_t size),
            (descriptor, data, size))
SEGSIM_CALL(ssize_t, kWrite, pwrite,
            (int descriptor, const void* data, std::size_t size, off_t at),
            (descriptor, data, size, at))
SEGSIM_CALL(ssize_t, kWrite, pwrite64,
            (int descriptor, const void* data, std::size_t size, off64_t at),
            (descriptor, data, size, at))
SEGSIM_CALL(ssize_t, kWrite, writev, (int descriptor, const iovec* parts, int count),
            (descriptor, parts, count))
SEGSIM_CALL(int, kWrite, ftruncate, (int descriptor, off_t size) noexcept, (descriptor, size))
SEGSIM_CALL(int, kWrite, ftruncate64, (int descriptor, off64_t size) noexcept,
            (descriptor, size))
SEGSIM_CALL(ssize_t, kWrite, sendfile, (int descriptor, int from, off_t* at, std::size_t size),
            (descriptor, from, at, size))
SEGSIM_CALL(int, kSync, fsync, (int descriptor), (descriptor))
SEGSIM_CALL(int, kSync, fdatasync, (int descriptor), (descriptor))

/// What the C library writes of its own buffers passes through no call that can be replaced,
/// so these stand for it.
std::size_t fwrite(const void* data, std::size_t size, std::size_t count, FILE* file) {
  NEXT(fwrite);
  if (counts(kWrite) && fails_at_descriptor(kWrite, "fwrite", fileno(file))) return 0;
  return next_one(data, size, count, file);
}
int fflush(FILE* file) {
  NEXT(fflush);
  if (file != nullptr && fails_at_descriptor(kWrite, "fflush", fileno(file))) return EOF;
  return next_one(file);
}
int fclose(FILE* file) {
  NEXT(fclose);
  const bool failed = (fcntl(fileno(file), F_GETFL) & O_ACCMODE) != O_RDONLY &&
                      fails_at_descriptor(kWrite, "fclose", fileno(file));
  const int result = next_one(file);
  if (failed) errno = plan.error;
  return failed ? EOF : result;
}

int rename(const char* from, const char* to) noexcept {
  NEXT(rename);
  if (fails_at_path(kRename, "rename", to)) return -1;
  return next_one(from, to);
}
int link(const char* from, const char* to) noexcept {
  NEXT(link);
  if (fails_at_path(kRename, "link", to)) return -1;
  return next_one(from, to);
}
int mkdir(const char* path, mode_t mode) noexcept {
  NEXT(mkdir);
  if (fails_at_path(kOpen, "mkdir", path)) return -1;
  return next_one(path, mode);
}

/// Of files alone: oneDNN asks for the memory of its machine code here, and does not look
/// whether it has it.
#define SEGSIM_MAP(function)                                                          \
  void* function(void* place, std::size_t size, int protection, int flags, int file,  \
                 off_t at) noexcept {                                                 \
    NEXT(function);                                                                   \
    if ((flags & MAP_ANONYMOUS) == 0 && fails_at_descriptor(kMap, #function, file)) { \
      return MAP_FAILED;                                                              \
    }                                                                                 \
    return next_one(place, size, protection, flags, file, at);                        \
  }
SEGSIM_MAP(mmap)
SEGSIM_MAP(mmap64)

void* malloc(std::size_t size) {
  return fails_at_size(kMemory, "malloc", size) ? nullptr : __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  return fails_at_size(kMemory, "calloc", count * size) ? nullptr : __libc_calloc(count, size);
}
void* realloc(void* old, std::size_t size) {
  return fails_at_size(kMemory, "realloc", size) ? nullptr : __libc_realloc(old, size);
}
void* memalign(std::size_t alignment, std::size_t size) {
  return fails_at_size(kMemory, "memalign", size) ? nullptr : __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  return fails_at_size(kMemory, "aligned_alloc", size) ? nullptr
                                                       : __libc_memalign(alignment, size);
}
int posix_memalign(void** place, std::size_t alignment, std::size_t size) {
  if (fails_at_size(kMemory, "posix_memalign", size)) return ENOMEM;
  void* found = __libc_memalign(alignment, size);
  if (found == nullptr) return ENOMEM;
  *place = found;
  return 0;
}

}  // extern "C"
