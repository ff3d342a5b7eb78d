#pragma once

/// @file
/// A network of somebody else, run as it is: tensors in by name, tensors out by name. Adapters
/// (object_detector.h, prompt_segmenter.h, image_text_scorer.h) put images and text in front.
///
///     .onnx                 an executor on ATen (internal/onnx_model.h), or ONNX Runtime
///     where
///                           CMake found one
///     TorchScript archive   libtorch. Loading one runs the code in it: it is a program
///
/// The format is told by the content, not by the extension.

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <variant>
#include <vector>

namespace segsim::perception {

/// Numbers of a tensor in host memory, row-major.
struct HostTensor {
  std::vector<std::int64_t> shape;
  /// Floating types as float; integers and truth values as int64.
  std::variant<std::vector<float>, std::vector<std::int64_t>> values;

  /// @throws core::ContractViolation if it has numbers of the other kind.
  [[nodiscard]] const std::vector<float>& floats() const;
  [[nodiscard]] const std::vector<std::int64_t>& integers() const;
};

/// What the file says about an input or output.
struct TensorInfo {
  std::string name;
  /// "float", "float16", "int64", "bool", ...; empty if the file does not say.
  std::string type;
  bool shape_known = false;
  std::vector<std::int64_t> shape;  ///< -1: free.

  /// "images float [1, 3, -1, -1]"
  [[nodiscard]] std::string describe() const;
};

struct ModelOutput {
  std::string name;  ///< TorchScript: key of a dict, else "output0", "output1", ...
  HostTensor tensor;
};

/// One object serves one thread at a time. Equal inputs give equal outputs (for an equal
/// number of threads, see set_threads() in perception/detector/detector.h).
class ModelSession {
 public:
  ModelSession() = default;
  virtual ~ModelSession() = default;
  ModelSession(const ModelSession&) = delete;
  ModelSession& operator=(const ModelSession&) = delete;

  /// "ONNX on ATen", "ONNX Runtime", "TorchScript".
  [[nodiscard]] virtual const std::string& runtime() const = 0;
  [[nodiscard]] virtual const std::vector<TensorInfo>& inputs() const = 0;
  /// Empty for TorchScript, which does not say.
  [[nodiscard]] virtual const std::vector<TensorInfo>& outputs() const = 0;
  /// What the exporter wrote beside the graph: Ultralytics has "names", "imgsz", "task".
  [[nodiscard]] virtual const std::map<std::string, std::string>& metadata() const = 0;

  /// Numbers are converted to the input's type.
  /// @throws core::InputError naming the node (ONNX) or function if a shape does not fit, an
  /// input is missing or unknown, or the model computes an index out of range.
  [[nodiscard]] virtual std::vector<ModelOutput> run(
      const std::map<std::string, HostTensor>& inputs) = 0;
};

/// @throws core::InputError for a damaged file; for ONNX also for an operator, attribute or
/// type that is not supported, naming the node, the operator and its opset; for TorchScript
/// for an operator that this libtorch lacks.
[[nodiscard]] std::unique_ptr<ModelSession> open_model(const std::filesystem::path& file);

/// The element with that name. @throws core::InputError that starts with `place`.
[[nodiscard]] const HostTensor& find_output(const std::vector<ModelOutput>& outputs,
                                            const std::string& name, const std::string& place);

/// "[1, 3, 640, 640]"
[[nodiscard]] std::string shape_text(const std::vector<std::int64_t>& shape);

}  // namespace segsim::perception
