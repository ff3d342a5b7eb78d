// TorchScript archives through libtorch, with the operators that it lacks.
#include <torch/script.h>
#include <torch/version.h>

#include <algorithm>
#include <cmath>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "perception/checkpoint/zip_file.h"
#include "perception/internal/network/thread_count.h"
#include "perception/models/internal/host_tensor_convert.h"
#include "perception/models/internal/roi_align.h"
#include "perception/models/internal/sessions.h"

namespace segsim::perception {
namespace {

using core::InputError;

at::Tensor torchvision_nms(const at::Tensor& boxes, const at::Tensor& scores, double max_iou) {
  TORCH_CHECK(boxes.dim() == 2 && boxes.size(1) == 4 && scores.dim() == 1 &&
                  scores.size(0) == boxes.size(0),
              "torchvision::nms: expected boxes [n, 4] and scores [n]");
  const at::Tensor b = boxes.to(at::kCPU, at::kFloat).contiguous();
  const at::Tensor s = scores.to(at::kCPU, at::kFloat).contiguous();
  std::vector<std::int64_t> all(static_cast<std::size_t>(b.size(0)));
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = static_cast<std::int64_t>(i);
  const auto kept = greedy_suppression(b.data_ptr<float>(), s.data_ptr<float>(), all, max_iou,
                                       static_cast<std::int64_t>(all.size()));
  return at::tensor(at::ArrayRef<std::int64_t>(kept), at::kLong).to(boxes.device());
}

at::Tensor torchvision_roi_align(const at::Tensor& input, const at::Tensor& rois, double scale,
                                 std::int64_t height, std::int64_t width, std::int64_t samples,
                                 bool aligned) {
  TORCH_CHECK(
      input.dim() == 4 && rois.dim() == 2 && rois.size(1) == 5 && height > 0 && width > 0,
      "torchvision::roi_align: expected input [n, c, h, w] and rois [boxes, 5]");
  const at::Tensor images = rois.select(1, 0).to(at::kCPU).to(at::kLong);
  TORCH_CHECK(images.numel() == 0 || (images.min().item<std::int64_t>() >= 0 &&
                                      images.max().item<std::int64_t>() < input.size(0)),
              "torchvision::roi_align: a box of an image that is not there");
  RoiAlignRule rule{height, width, samples, scale, aligned, false};
  return roi_align(input.to(at::kCPU), rois.slice(1, 1, 5).to(at::kCPU), images, rule)
      .to(input.options());
}

#if TORCH_VERSION_MAJOR < 2
/// softmax(q k^T * scale + mask) v, as newer versions define it.
at::Tensor attention(const at::Tensor& query, const at::Tensor& key, const at::Tensor& value,
                     const c10::optional<at::Tensor>& mask, double dropout, bool causal,
                     c10::optional<double> scale) {
  TORCH_CHECK(dropout == 0.0,
              "scaled_dot_product_attention: expected dropout_p 0 at inference");
  const double factor =
      scale.has_value() ? *scale : 1.0 / std::sqrt(static_cast<double>(query.size(-1)));
  at::Tensor weights = at::matmul(query * factor, key.transpose(-2, -1));
  const double lowest = -std::numeric_limits<double>::infinity();
  if (causal) {
    const at::Tensor keep =
        at::ones({query.size(-2), key.size(-2)}, query.options().dtype(at::kBool)).tril();
    weights = weights.masked_fill(keep.logical_not(), lowest);
  }
  if (mask.has_value() && mask->defined()) {
    weights = mask->scalar_type() == at::kBool
                  ? weights.masked_fill(mask->logical_not(), lowest)
                  : weights + *mask;
  }
  return at::matmul(at::softmax(weights, -1), value);
}

TORCH_LIBRARY_FRAGMENT(aten, library) {
  library.def(
      "scaled_dot_product_attention(Tensor query, Tensor key, Tensor value, "
      "Tensor? attn_mask=None, float dropout_p=0.0, bool is_causal=False, *, "
      "float? scale=None) -> Tensor",
      &attention);
}
#endif

TORCH_LIBRARY_FRAGMENT(torchvision, library) {
  library.def("nms(Tensor dets, Tensor scores, float iou_threshold) -> Tensor",
              &torchvision_nms);
  library.def(
      "roi_align(Tensor input, Tensor rois, float spatial_scale, int pooled_height, "
      "int pooled_width, int sampling_ratio, bool aligned) -> Tensor",
      &torchvision_roi_align);
}

/// The line that names the operator, if that is what is missing.
std::string explain(const std::string& message) {
  for (const char* sign : {"Unknown builtin op: ", "Couldn't find an operator for "}) {
    const std::size_t at = message.find(sign);
    if (at == std::string::npos) continue;
    const std::size_t start = at + std::string(sign).size();
    const std::size_t end = message.find_first_of(".\n", start);
    return "expected operators that libtorch " TORCH_VERSION " has, found " +
           message.substr(start, end - start);
  }
  return first_line(message);
}

/// Damage would reach libtorch's own reader, which trusts the file more than it should.
void check_archive(const std::filesystem::path& file) {
  const std::string bytes = core::read_file(file);
  bool code = false;
  for (const ZipRecord& record : list_zip(bytes, file.string())) {
    if (record.plain) (void)read_record(bytes, record, file.string());
    code = code || record.name.find("/code/") != std::string::npos;
  }
  if (!code) {
    throw InputError::expected(file.string(), "a TorchScript archive, which has code",
                               "weights alone (see `segsim detector import`)");
  }
}

class TorchScriptSession final : public ModelSession {
 public:
  explicit TorchScriptSession(const std::filesystem::path& file) : place_(file.string()) {
    check_archive(file);
    apply_thread_count();
    torch::jit::ExtraFilesMap extra{{"config.txt", ""}};
    try {
      module_ = torch::jit::load(place_, c10::Device(c10::kCPU), extra);
      module_.eval();
      read_inputs();
    } catch (const c10::Error& error) {
      throw InputError(place_ + ": " + explain(error.what_without_backtrace()));
    } catch (const std::runtime_error& error) {  // The compiler of TorchScript has its own.
      throw InputError(place_ + ": " + explain(error.what()));
    }
    read_metadata(extra["config.txt"]);
  }

  [[nodiscard]] const std::string& runtime() const override {
    static const std::string kName = "TorchScript";
    return kName;
  }
  [[nodiscard]] const std::vector<TensorInfo>& inputs() const override { return inputs_; }
  [[nodiscard]] const std::vector<TensorInfo>& outputs() const override { return outputs_; }
  [[nodiscard]] const std::map<std::string, std::string>& metadata() const override {
    return metadata_;
  }

  [[nodiscard]] std::vector<ModelOutput> run(
      const std::map<std::string, HostTensor>& inputs) override {
    apply_thread_count();
    std::vector<c10::IValue> arguments;
    for (const TensorInfo& info : inputs_) {
      const auto given = inputs.find(info.name);
      const std::string place = place_ + ": input '" + info.name + "'";
      if (given == inputs.end()) throw InputError::expected(place, "a tensor", "none");
      const bool floating = std::holds_alternative<std::vector<float>>(given->second.values);
      arguments.emplace_back(
          to_tensor(given->second, floating ? at::kFloat : at::kLong, place));
    }
    if (inputs.size() != inputs_.size()) {
      throw InputError::expected(place_, std::to_string(inputs_.size()) + " inputs",
                                 std::to_string(inputs.size()));
    }
    const torch::NoGradGuard no_gradients;
    std::vector<ModelOutput> outputs;
    try {
      collect(module_.forward(std::move(arguments)), "", outputs);
    } catch (const c10::Error& error) {
      throw InputError(place_ + ": forward(): " + last_line(error.what_without_backtrace()));
    } catch (const std::runtime_error& error) {
      throw InputError(place_ + ": forward(): " + last_line(error.what()));
    }
    return outputs;
  }

 private:
  void read_inputs() {
    const auto& arguments = module_.get_method("forward").function().getSchema().arguments();
    for (std::size_t i = 1; i < arguments.size(); ++i) {
      if (arguments[i].default_value().has_value()) continue;
      TensorInfo info;
      info.name = arguments[i].name();
      inputs_.push_back(std::move(info));
    }
  }

  /// Ultralytics writes a JSON object.
  void read_metadata(const std::string& config) {
    const auto json = nlohmann::json::parse(config, nullptr, false);
    if (!json.is_object()) return;
    for (const auto& [key, value] : json.items()) {
      metadata_[key] = value.is_string() ? value.get<std::string>() : value.dump();
    }
  }

  /// An interpreter's error is a stack of source lines with the cause at its end.
  static std::string last_line(const std::string& message) {
    std::string text = message;
    while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
    const std::size_t at = text.find("RuntimeError: ");
    return first_line(at == std::string::npos ? text : text.substr(at));
  }

  void collect(const c10::IValue& value, const std::string& name,
               std::vector<ModelOutput>& outputs) const {
    if (value.isTensor()) {
      outputs.push_back({name.empty() ? "output" + std::to_string(outputs.size()) : name,
                         to_host_tensor(value.toTensor())});
    } else if (value.isTuple()) {
      for (const auto& item : value.toTupleRef().elements()) collect(item, "", outputs);
    } else if (value.isList()) {
      for (const c10::IValue& item : value.toListRef()) collect(item, "", outputs);
    } else if (value.isGenericDict()) {
      for (const auto& entry : value.toGenericDict()) {
        collect(entry.value(), entry.key().isString() ? entry.key().toStringRef() : "",
                outputs);
      }
    } else if (!value.isNone()) {
      throw InputError::expected(place_ + ": forward()", "tensors", value.tagKind());
    }
  }

  std::string place_;
  torch::jit::Module module_;
  std::vector<TensorInfo> inputs_, outputs_;
  std::map<std::string, std::string> metadata_;
};

}  // namespace

std::unique_ptr<ModelSession> open_torchscript(const std::filesystem::path& file) {
  return std::make_unique<TorchScriptSession>(file);
}

}  // namespace segsim::perception
