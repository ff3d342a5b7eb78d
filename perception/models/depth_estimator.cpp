#include "perception/models/depth_estimator.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "core/error.h"
#include "perception/models/internal/bilinear.h"
#include "perception/models/internal/preprocess.h"
#include "perception/models/model_description.h"

namespace segsim::perception {
namespace {

using core::InputError;

constexpr int kUsualHeightPx = 384, kUsualWidthPx = 512;  ///< ZoeDepth's.

class MetricDepth final : public DepthEstimator {
 public:
  explicit MetricDepth(const ModelDescription& description)
      : place_(description.file("model").string()),
        session_(open_model(place_)),
        colours_(description.centred_colours ? kHalfAndHalf : kImageNet) {
    const TensorInfo& input = image_input(*session_, place_);
    input_ = input.name;
    height_px_ = stated_side(input, 2, description.height_px.value_or(kUsualHeightPx));
    width_px_ = stated_side(input, 3, description.width_px.value_or(kUsualWidthPx));
  }

  void infer(const core::Image<core::Rgb8>& image, core::Image<float>& depth_m) override {
    const ColourImage scaled =
        resize_like_pillow(image, width_px_, height_px_, Kernel::kLinear);
    const std::vector<ModelOutput> outputs =
        session_->run({{input_, to_planes(scaled, width_px_, height_px_, colours_)}});
    const HostTensor& answer = checked(outputs);
    const auto rows = static_cast<int>(answer.shape[answer.shape.size() - 2]);
    const auto columns = static_cast<int>(answer.shape.back());
    const FloatGrid grid{answer.floats().data(), columns, rows};
    depth_m.resize(image.width_px(), image.height_px());
    const double step_x = static_cast<double>(columns) / image.width_px();
    const double step_y = static_cast<double>(rows) / image.height_px();
    for (int y = 0; y < image.height_px(); ++y) {
      for (int x = 0; x < image.width_px(); ++x) {
        depth_m(x, y) = bilinear(grid, (x + 0.5) * step_x - 0.5, (y + 0.5) * step_y - 0.5);
      }
    }
  }

 private:
  /// One finite depth, not negative, for each pixel of one image.
  [[nodiscard]] const HostTensor& checked(const std::vector<ModelOutput>& outputs) const {
    const HostTensor* named = find_output(outputs, {"predicted_depth", "depth", "output"});
    if (named == nullptr && outputs.size() == 1) named = &outputs.front().tensor;
    const bool fits = named != nullptr && named->shape.size() >= 2 &&
                      std::holds_alternative<std::vector<float>>(named->values);
    if (!fits)
      throw InputError::expected(place_, "an output predicted_depth or depth", "none");
    const std::vector<std::int64_t>& shape = named->shape;
    const std::vector<float>& values = named->floats();
    if (values.empty() ||
        static_cast<std::int64_t>(values.size()) != shape[shape.size() - 2] * shape.back()) {
      throw InputError::expected(place_, "depth [1, h, w]", shape_text(shape));
    }
    const auto wrong = std::find_if(values.begin(), values.end(), [](float depth) {
      return !(std::isfinite(depth) && depth >= 0.0F);
    });
    if (wrong != values.end()) {
      throw InputError::expected(place_, "depths in metres", std::to_string(*wrong));
    }
    return *named;
  }

  std::string place_;
  std::unique_ptr<ModelSession> session_;
  Normalisation colours_;
  std::string input_;
  int height_px_ = 0, width_px_ = 0;
};

}  // namespace

std::unique_ptr<DepthEstimator> load_depth_estimator(const std::filesystem::path& model) {
  const ModelDescription description = read_model_description(model);
  if (description.task != ModelTask::kDepth) {
    throw InputError::expected(description.place, "a description with task depth",
                               "a model of another task");
  }
  return std::make_unique<MetricDepth>(description);
}

}  // namespace segsim::perception
