#include <algorithm>

#include <ATen/ATen.h>
#include <c10/core/InferenceMode.h>

#include "core/error.h"
#include "perception/internal/network/thread_count.h"
#include "perception/models/internal/host_tensor_convert.h"
#include "perception/models/internal/onnx/onnx_model.h"
#include "perception/models/internal/sessions.h"

namespace segsim::perception {
namespace {

class OnnxSession final : public ModelSession {
 public:
  explicit OnnxSession(const std::filesystem::path& file) {
    apply_thread_count();
    const c10::InferenceMode inference;
    model_ = graph::read_model(file);
  }

  [[nodiscard]] const std::string& runtime() const override {
    static const std::string kName = "ONNX on ATen";
    return kName;
  }
  [[nodiscard]] const std::vector<TensorInfo>& inputs() const override {
    return model_->inputs;
  }
  [[nodiscard]] const std::vector<TensorInfo>& outputs() const override {
    return model_->outputs;
  }
  [[nodiscard]] const std::map<std::string, std::string>& metadata() const override {
    return model_->metadata;
  }

  [[nodiscard]] std::vector<ModelOutput> run(
      const std::map<std::string, HostTensor>& inputs) override {
    apply_thread_count();
    const c10::InferenceMode inference;
    const graph::Values results =
        graph::execute(model_->graph, model_->place, convert(inputs), {});
    std::vector<ModelOutput> outputs;
    for (std::size_t i = 0; i < results.size(); ++i) {
      const std::string& name = model_->outputs[i].name;
      if (!results[i].tensor.defined()) {
        throw core::InputError::expected(model_->place + ": output '" + name + "'", "a tensor",
                                         "a list or nothing");
      }
      outputs.push_back({name, to_host_tensor(results[i].tensor)});
    }
    return outputs;
  }

 private:
  [[nodiscard]] graph::Values convert(const std::map<std::string, HostTensor>& inputs) const {
    graph::Values values;
    for (std::size_t i = 0; i < model_->inputs.size(); ++i) {
      const TensorInfo& info = model_->inputs[i];
      const std::string place = model_->place + ": input '" + info.name + "'";
      const auto given = inputs.find(info.name);
      if (given == inputs.end()) throw core::InputError::expected(place, "a tensor", "none");
      check_shape(info, given->second, place);
      values.emplace_back(to_tensor(given->second, model_->input_types[i], place));
    }
    for (const auto& [name, tensor] : inputs) {
      const bool known = std::any_of(model_->inputs.begin(), model_->inputs.end(),
                                     [&, n = &name](const auto& i) { return i.name == *n; });
      if (!known) {
        throw core::InputError::expected(model_->place, "an input of the model",
                                         "'" + name + "'");
      }
    }
    return values;
  }

  static void check_shape(const TensorInfo& info, const HostTensor& tensor,
                          const std::string& place) {
    if (!info.shape_known) return;
    const bool fits =
        info.shape.size() == tensor.shape.size() &&
        std::equal(info.shape.begin(), info.shape.end(), tensor.shape.begin(),
                   [](std::int64_t a, std::int64_t b) { return a < 0 || a == b; });
    if (!fits) {
      throw core::InputError::expected(place, shape_text(info.shape) + " (-1: any)",
                                       shape_text(tensor.shape));
    }
  }

  std::shared_ptr<const graph::Model> model_;
};

}  // namespace

std::unique_ptr<ModelSession> open_onnx(const std::filesystem::path& file) {
  return std::make_unique<OnnxSession>(file);
}

}  // namespace segsim::perception
