#include "core/file_io.h"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <memory>
#include <sstream>
#include <vector>

#include <openssl/evp.h>

#include "core/check.h"
#include "core/error.h"
#include "core/input/regular_file.h"
#include "core/system/remakeable_file.h"
#include "core/system/sync_to_disk.h"
#include "core/system/system_random.h"

namespace segsim::core {
namespace {

namespace fs = std::filesystem;

enum class Durability {
  kOnDisk,      ///< Survives a power cut once the call returns.
  kRemakeable,  ///< core/system/remakeable_file.h
};

fs::path temporary_name(const fs::path& file) {
  return file.parent_path() /
         ("." + file.stem().string() + ".tmp" + unique_suffix() + file.extension().string());
}

fs::path folder_of(const fs::path& file) {
  return file.has_parent_path() ? file.parent_path() : fs::path(".");
}

/// What a user can do something about: a full disk, a name that is too long, or most often a
/// folder that nobody, or not this user, may write to.
[[noreturn]] void refuse_place(const fs::path& file, int code) {
  if (code == EROFS || code == EACCES || code == EPERM) {
    throw InputError::expected(
        file.string(), "a folder that can be written to",
        code == EROFS
            ? folder_of(file).string() + ", which is read-only"
            : folder_of(file).string() + ", which may not be: " + std::strerror(code));
  }
  throw InputError::expected(file.string(), "a writable file", std::strerror(code));
}

/// Asks before it opens: opening a pipe waits for a writer.
std::ifstream open_to_read(const fs::path& file) {
  std::ifstream stream;
  if (can_be_read(file)) stream.open(file, std::ios::binary);
  if (!stream.is_open()) {
    std::error_code error;
    const bool other = fs::exists(file, error) && !can_be_read(file);
    throw InputError::expected(file.string(), "a readable file",
                               other ? "no regular file" : "none");
  }
  return stream;
}

class Sha256 {
 public:
  Sha256() : context_(EVP_MD_CTX_new(), &EVP_MD_CTX_free) {
    SEGSIM_CHECK(context_ != nullptr, "EVP_MD_CTX_new");
    SEGSIM_CHECK(EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr) == 1, "SHA-256");
  }
  void add(const void* data, std::size_t size) {
    SEGSIM_CHECK(EVP_DigestUpdate(context_.get(), data, size) == 1, "SHA-256");
  }
  std::string hex() {
    std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
    unsigned int size = 0;
    SEGSIM_CHECK(EVP_DigestFinal_ex(context_.get(), digest.data(), &size) == 1, "SHA-256");
    static constexpr char kDigits[] = "0123456789abcdef";
    std::string text;
    for (unsigned int i = 0; i < size; ++i) {
      text += kDigits[digest[i] >> 4U];
      text += kDigits[digest[i] & 15U];
    }
    return text;
  }

 private:
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context_;
};

/// @param name  Of messages.
void sync_as(const fs::path& file_or_folder, const fs::path& name) {
  const int descriptor = ::open(file_or_folder.c_str(), O_RDONLY | O_CLOEXEC);
  const bool opened = descriptor >= 0;
  const bool done = opened && ::fsync(descriptor) == 0;
  const int code = errno;
  if (opened) ::close(descriptor);
  // Some network and FUSE file systems cannot sync folders: they have nothing to wait for.
  if (done || (opened && code == EINVAL)) return;
  throw InputError::expected(name.string(), "a disk that keeps what is written",
                             std::strerror(code));
}

void make_parent(const fs::path& file) {
  if (!file.has_parent_path()) return;
  std::error_code error;
  fs::create_directories(file.parent_path(), error);
  if (error) {
    throw InputError::expected(file.parent_path().string(), "a folder that can be made",
                               error.message());
  }
}

void write_and_rename(const fs::path& file, Durability durability,
                      const std::function<void(const fs::path&)>& write) {
  make_parent(file);
  const fs::path temporary = temporary_name(file);
  const bool waits = durability == Durability::kOnDisk;
  try {
    write(temporary);
    // In this order: else a power cut could leave the name without what it stands for.
    if (waits) sync_as(temporary, file);
    fs::rename(temporary, file);
    if (waits) sync_as(folder_of(file), file);
  } catch (const fs::filesystem_error& error) {
    std::error_code ignored;
    fs::remove(temporary, ignored);
    refuse_place(file, error.code().value());
  } catch (...) {
    std::error_code ignored;
    fs::remove(temporary, ignored);
    throw;
  }
}

void write_stream_and_rename(const fs::path& file, Durability durability,
                             const std::function<void(std::ostream&)>& write) {
  write_and_rename(file, durability, [&](const fs::path& temporary) {
    std::ofstream stream(temporary, std::ios::binary);
    if (!stream) refuse_place(file, errno);
    write(stream);
    stream.close();  // Network file systems tell only here that the disk is full.
    if (!stream) {
      throw InputError::expected(file.string(), "room to write", std::strerror(errno));
    }
  });
}

}  // namespace

void sync_to_disk(const fs::path& file_or_folder) { sync_as(file_or_folder, file_or_folder); }

void write_via_temporary(const fs::path& file,
                         const std::function<void(const fs::path&)>& write) {
  write_and_rename(file, Durability::kOnDisk, write);
}

void write_file_atomically(const fs::path& file,
                           const std::function<void(std::ostream&)>& write) {
  write_stream_and_rename(file, Durability::kOnDisk, write);
}

void write_remakeable_via_temporary(const fs::path& file,
                                    const std::function<void(const fs::path&)>& write) {
  write_and_rename(file, Durability::kRemakeable, write);
}

void write_remakeable_file(const fs::path& file,
                           const std::function<void(std::ostream&)>& write) {
  write_stream_and_rename(file, Durability::kRemakeable, write);
}

std::string read_file(const fs::path& file) {
  std::ifstream stream = open_to_read(file);
  std::ostringstream text;
  text << stream.rdbuf();
  return std::move(text).str();
}

std::string sha256_hex(std::span<const std::byte> bytes) {
  Sha256 hash;
  hash.add(bytes.data(), bytes.size());
  return hash.hex();
}

std::string sha256_hex(const std::string& text) {
  return sha256_hex(std::as_bytes(std::span(text.data(), text.size())));
}

std::string sha256_of_file(const fs::path& file) {
  std::ifstream stream = open_to_read(file);
  Sha256 hash;
  std::vector<char> buffer(1U << 20U);
  while (stream.read(buffer.data(), static_cast<std::streamsize>(buffer.size())) ||
         stream.gcount() > 0) {
    hash.add(buffer.data(), static_cast<std::size_t>(stream.gcount()));
  }
  return hash.hex();
}

}  // namespace segsim::core
