// ONNX Runtime, where it is installed. Same tensors in and out as the executor on ATen.
#include <onnxruntime_cxx_api.h>

#include <algorithm>

#include "core/error.h"
#include "perception/detector/detector.h"
#include "perception/models/internal/host_tensor_convert.h"
#include "perception/models/internal/sessions.h"

namespace segsim::perception {
namespace {

using core::InputError;

struct Type {
  ONNXTensorElementDataType runtime;
  const char* name;
  at::ScalarType tensor;
};

constexpr Type kTypes[] = {
    {ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT, "float", at::kFloat},
    {ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT16, "float16", at::kHalf},
    {ONNX_TENSOR_ELEMENT_DATA_TYPE_DOUBLE, "double", at::kDouble},
    {ONNX_TENSOR_ELEMENT_DATA_TYPE_UINT8, "uint8", at::kByte},
    {ONNX_TENSOR_ELEMENT_DATA_TYPE_INT8, "int8", at::kChar},
    {ONNX_TENSOR_ELEMENT_DATA_TYPE_INT16, "int16", at::kShort},
    {ONNX_TENSOR_ELEMENT_DATA_TYPE_INT32, "int32", at::kInt},
    {ONNX_TENSOR_ELEMENT_DATA_TYPE_INT64, "int64", at::kLong},
    {ONNX_TENSOR_ELEMENT_DATA_TYPE_BOOL, "bool", at::kBool},
};

const Type& type_of(ONNXTensorElementDataType runtime, const std::string& place) {
  const auto* found = std::find_if(std::begin(kTypes), std::end(kTypes),
                                   [&](const Type& type) { return type.runtime == runtime; });
  if (found == std::end(kTypes)) {
    throw InputError::expected(place, "a floating, integer or bool type",
                               "type " + std::to_string(static_cast<int>(runtime)));
  }
  return *found;
}

Ort::Env& environment() {
  static Ort::Env env(ORT_LOGGING_LEVEL_ERROR, "segsim");
  return env;
}

class RuntimeSession final : public ModelSession {
 public:
  explicit RuntimeSession(const std::filesystem::path& file) : place_(file.string()) {
    Ort::SessionOptions options;
    options.SetIntraOpNumThreads(threads());
    options.SetGraphOptimizationLevel(GraphOptimizationLevel::ORT_ENABLE_ALL);
    try {
      session_ = Ort::Session(environment(), file.c_str(), options);
      read_signature();
    } catch (const Ort::Exception& error) {
      throw InputError(place_ + ": " + first_line(error.what()));
    }
  }

  [[nodiscard]] const std::string& runtime() const override {
    static const std::string kName = "ONNX Runtime";
    return kName;
  }
  [[nodiscard]] const std::vector<TensorInfo>& inputs() const override { return inputs_; }
  [[nodiscard]] const std::vector<TensorInfo>& outputs() const override { return outputs_; }
  [[nodiscard]] const std::map<std::string, std::string>& metadata() const override {
    return metadata_;
  }

  [[nodiscard]] std::vector<ModelOutput> run(
      const std::map<std::string, HostTensor>& inputs) override {
    if (inputs.size() != inputs_.size()) {
      throw InputError::expected(place_, std::to_string(inputs_.size()) + " inputs",
                                 std::to_string(inputs.size()));
    }
    const auto memory = Ort::MemoryInfo::CreateCpu(OrtArenaAllocator, OrtMemTypeDefault);
    std::vector<at::Tensor> tensors;  // Own the memory of the values.
    std::vector<Ort::Value> values;
    std::vector<const char*> input_names, output_names;
    for (std::size_t i = 0; i < inputs_.size(); ++i) {
      const std::string place = place_ + ": input '" + inputs_[i].name + "'";
      const auto given = inputs.find(inputs_[i].name);
      if (given == inputs.end()) throw InputError::expected(place, "a tensor", "none");
      tensors.push_back(to_tensor(given->second, input_types_[i].tensor, place));
      const at::Tensor& tensor = tensors.back();
      values.push_back(Ort::Value::CreateTensor(
          memory, tensor.data_ptr(), static_cast<std::size_t>(tensor.nbytes()),
          tensor.sizes().data(), tensor.sizes().size(), input_types_[i].runtime));
      input_names.push_back(inputs_[i].name.c_str());
    }
    for (const TensorInfo& output : outputs_) output_names.push_back(output.name.c_str());
    try {
      return collect(session_.Run(Ort::RunOptions{nullptr}, input_names.data(), values.data(),
                                  values.size(), output_names.data(), output_names.size()));
    } catch (const Ort::Exception& error) {
      throw InputError(place_ + ": " + first_line(error.what()));
    }
  }

 private:
  void read_signature() {
    Ort::AllocatorWithDefaultOptions allocator;
    const auto describe = [&](const std::string& name, const Ort::TypeInfo& type) {
      const auto tensor = type.GetTensorTypeAndShapeInfo();
      TensorInfo info;
      info.name = name;
      info.type = type_of(tensor.GetElementType(), place_ + ": '" + name + "'").name;
      info.shape_known = true;
      info.shape = tensor.GetShape();
      return info;
    };
    for (std::size_t i = 0; i < session_.GetInputCount(); ++i) {
      const Ort::TypeInfo type = session_.GetInputTypeInfo(i);
      inputs_.push_back(describe(session_.GetInputNameAllocated(i, allocator).get(), type));
      input_types_.push_back(
          type_of(type.GetTensorTypeAndShapeInfo().GetElementType(), place_));
    }
    for (std::size_t i = 0; i < session_.GetOutputCount(); ++i) {
      outputs_.push_back(describe(session_.GetOutputNameAllocated(i, allocator).get(),
                                  session_.GetOutputTypeInfo(i)));
    }
    const Ort::ModelMetadata metadata = session_.GetModelMetadata();
    for (const auto& key : metadata.GetCustomMetadataMapKeysAllocated(allocator)) {
      metadata_[key.get()] =
          metadata.LookupCustomMetadataMapAllocated(key.get(), allocator).get();
    }
  }

  [[nodiscard]] std::vector<ModelOutput> collect(std::vector<Ort::Value> values) const {
    std::vector<ModelOutput> outputs;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const auto info = values[i].GetTensorTypeAndShapeInfo();
      const Type& type = type_of(info.GetElementType(), place_ + ": " + outputs_[i].name);
      const std::vector<std::int64_t> shape = info.GetShape();
      const at::Tensor view =
          at::from_blob(values[i].GetTensorMutableRawData(), shape, at::dtype(type.tensor));
      outputs.push_back({outputs_[i].name, to_host_tensor(view)});
    }
    return outputs;
  }

  std::string place_;
  Ort::Session session_{nullptr};
  std::vector<TensorInfo> inputs_, outputs_;
  std::vector<Type> input_types_;
  std::map<std::string, std::string> metadata_;
};

}  // namespace

std::unique_ptr<ModelSession> open_onnxruntime(const std::filesystem::path& file) {
  return std::make_unique<RuntimeSession>(file);
}

}  // namespace segsim::perception
