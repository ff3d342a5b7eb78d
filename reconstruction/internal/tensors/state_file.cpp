#include "reconstruction/internal/tensors/state_file.h"

#include <sstream>

#include <torch/csrc/jit/serialization/pickle.h>

#include "core/error.h"
#include "core/file_io.h"

namespace segsim::reconstruction::internal {
namespace {

using core::InputError;
constexpr std::string_view kMagic = "SEGSIMHS1";
constexpr std::size_t kHashBytes = 64;

std::string shape_of(const Tensor& tensor) {
  std::ostringstream text;
  text << tensor.scalar_type() << ' ' << tensor.sizes();
  return text.str();
}

bool same_row(const Tensor& a, const Tensor& b) {
  return a.dim() == b.dim() && a.scalar_type() == b.scalar_type() &&
         (a.dim() == 0 || a.sizes().slice(1).equals(b.sizes().slice(1)));
}

}  // namespace

void StateWriter::put(const std::string& name, const Tensor& value) {
  tensors_[name] = value.detach().cpu().contiguous();
}

void StateWriter::put_integers(const std::string& name,
                               const std::vector<std::int64_t>& values) {
  tensors_[name] = device_tensor(values, torch::kInt64, torch::kCPU);
}

void StateWriter::write(const std::filesystem::path& file) const {
  c10::Dict<std::string, Tensor> dict;
  for (const auto& [name, tensor] : tensors_) dict.insert(name, tensor);
  const std::vector<char> bytes = torch::jit::pickle_save(c10::IValue(dict));
  const std::string payload = kind_ + '\n' + std::string(bytes.begin(), bytes.end());
  const std::string whole = std::string(kMagic) + core::sha256_hex(payload) + payload;
  core::write_file_atomically(file, [&](std::ostream& out) {
    out.write(whole.data(), static_cast<std::streamsize>(whole.size()));
  });
}

StateReader::StateReader(const std::filesystem::path& file, const std::string& kind)
    : place_(file.string()) {
  const std::string whole = core::read_file(file);
  if (!whole.starts_with(kMagic) || whole.size() < kMagic.size() + kHashBytes) {
    throw InputError::expected(place_, "a training state (" + std::string(kMagic) + ")",
                               std::to_string(whole.size()) + " other bytes");
  }
  const std::string payload = whole.substr(kMagic.size() + kHashBytes);
  if (core::sha256_hex(payload) != whole.substr(kMagic.size(), kHashBytes)) {
    throw InputError::expected(place_, "content with the SHA-256 of its header",
                               "another one");
  }
  const std::size_t end = payload.find('\n');
  if (payload.substr(0, end) != kind) {
    throw InputError::expected(place_, "a state of \"" + kind + "\"",
                               "one of \"" + payload.substr(0, end) + "\"");
  }
  const std::vector<char> bytes(payload.begin() + static_cast<std::ptrdiff_t>(end) + 1,
                                payload.end());
  const auto dict = torch::jit::pickle_load(bytes).toGenericDict();
  for (const auto& entry : dict) {
    tensors_[entry.key().toStringRef()] = entry.value().toTensor();
  }
}

const Tensor& StateReader::find(const std::string& name) const {
  const auto found = tensors_.find(name);
  if (found == tensors_.end()) {
    throw InputError::expected(place_, "a tensor \"" + name + "\"", "none");
  }
  return found->second;
}

Tensor StateReader::take(const std::string& name, const Tensor& like) const {
  const Tensor& tensor = find(name);
  if (!same_row(tensor, like)) {
    throw InputError::expected(place_ + ": " + name, shape_of(like), shape_of(tensor));
  }
  return tensor.to(like.device());
}

void StateReader::expect_rows(const std::string& name, std::int64_t rows) const {
  const Tensor& tensor = find(name);
  const std::int64_t found = tensor.dim() > 0 ? tensor.size(0) : 0;
  if (found != rows) {
    throw InputError::expected(place_ + ": " + name, std::to_string(rows) + " rows",
                               std::to_string(found));
  }
}

std::vector<std::int64_t> StateReader::integers(const std::string& name) const {
  const Tensor& tensor = find(name);
  if (tensor.scalar_type() != torch::kInt64) {
    throw InputError::expected(place_ + ": " + name, "integers", shape_of(tensor));
  }
  const auto* first = tensor.data_ptr<std::int64_t>();
  return {first, first + tensor.numel()};
}

}  // namespace segsim::reconstruction::internal
