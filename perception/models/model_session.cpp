#include "perception/models/model_session.h"

#include <algorithm>
#include <array>
#include <fstream>

#include "core/check.h"
#include "core/error.h"
#include "core/input/regular_file.h"
#include "perception/checkpoint/zip_file.h"
#include "perception/models/internal/sessions.h"

namespace segsim::perception {

const std::vector<float>& HostTensor::floats() const {
  SEGSIM_CHECK(std::holds_alternative<std::vector<float>>(values), "integers in a tensor");
  return std::get<std::vector<float>>(values);
}

const std::vector<std::int64_t>& HostTensor::integers() const {
  SEGSIM_CHECK(std::holds_alternative<std::vector<std::int64_t>>(values),
               "floats in a tensor");
  return std::get<std::vector<std::int64_t>>(values);
}

std::string TensorInfo::describe() const {
  std::string text = name;
  if (!type.empty()) text += " " + type;
  if (shape_known) text += " " + shape_text(shape);
  return text;
}

std::unique_ptr<ModelSession> open_model(const std::filesystem::path& file) {
  std::array<char, 4> start{};
  std::ifstream stream;
  if (core::can_be_read(file)) stream.open(file, std::ios::binary);
  if (!stream.is_open()) {
    throw core::InputError::expected(file.string(), "a model file", "no such file");
  }
  stream.read(start.data(), start.size());
  if (is_zip({start.data(), static_cast<std::size_t>(stream.gcount())})) {
    return open_torchscript(file);
  }
#ifdef SEGSIM_ONNXRUNTIME
  return open_onnxruntime(file);
#else
  return open_onnx(file);
#endif
}

const HostTensor& find_output(const std::vector<ModelOutput>& outputs, const std::string& name,
                              const std::string& place) {
  const auto found = std::find_if(outputs.begin(), outputs.end(),
                                  [&](const ModelOutput& o) { return o.name == name; });
  if (found == outputs.end()) {
    throw core::InputError::expected(place, "an output '" + name + "'", "none of that name");
  }
  return found->tensor;
}

}  // namespace segsim::perception
