#include "perception/yolov13/tensor_run.h"

#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "perception/checkpoint/tensor_file.h"
#include "perception/yolov13/model.h"

namespace segsim::perception::yolov13 {
namespace {

constexpr std::int64_t kMaxSide = 8192, kMaxPixels = std::int64_t{1} << 28U;

const StoredTensor* find(const TensorFile& file, const std::string& name) {
  const auto found = std::find_if(file.tensors.begin(), file.tensors.end(),
                                  [&](const auto& tensor) { return tensor.name == name; });
  return found == file.tensors.end() ? nullptr : &*found;
}

NamedTensor read_images(const TensorFile& file) {
  const StoredTensor* stored = find(file, "images");
  const auto fits = [](std::int64_t side) {
    return side >= 32 && side <= kMaxSide && side % 32 == 0;
  };
  if (stored == nullptr || stored->shape.size() != 4 || stored->shape[0] < 1 ||
      stored->shape[1] != 3 || !fits(stored->shape[2]) || !fits(stored->shape[3]) ||
      stored->shape[0] > kMaxPixels / (stored->shape[2] * stored->shape[3])) {
    throw core::InputError::expected(
        file.place + ": images",
        "[batch, 3, height, width] with sides that are multiples of 32",
        stored == nullptr ? "no such tensor" : "another shape");
  }
  return file.read(*stored);
}

using Truth = std::vector<std::vector<LabeledBox>>;

std::optional<Truth> read_truth(const TensorFile& file, std::int64_t batch, int class_count) {
  const StoredTensor* stored = find(file, "truth");
  if (stored == nullptr) return std::nullopt;
  constexpr std::size_t kColumns = 6;
  if (stored->shape.size() != 2 || stored->shape[1] != kColumns) {
    throw core::InputError::expected(file.place + ": truth", "[objects, 6]", "another shape");
  }
  const NamedTensor rows = file.read(*stored);
  Truth truth(static_cast<std::size_t>(batch));
  for (std::size_t i = 0; i + kColumns <= rows.values.size(); i += kColumns) {
    const float* row = rows.values.data() + i;
    const bool fits =
        row[0] >= 0.0F && row[0] < static_cast<float>(batch) && row[1] >= 0.0F &&
        row[1] < static_cast<float>(class_count) && row[2] < row[4] && row[3] < row[5] &&
        std::all_of(row, row + kColumns, [](float v) { return std::isfinite(v); });
    if (!fits) {
      throw core::InputError::expected(
          file.place + ": truth, row " + std::to_string(i / kColumns),
          "an image of the batch, a class of the weights and a box with an area", "others");
    }
    LabeledBox box;
    box.class_index = static_cast<int>(row[1]);
    box.box = {row[2], row[3], row[4], row[5]};
    truth[static_cast<std::size_t>(row[0])].push_back(box);
  }
  return truth;
}

}  // namespace

std::optional<LossValues> run_on_tensors(const std::filesystem::path& weights_file,
                                         const std::filesystem::path& input,
                                         const std::filesystem::path& output) {
  const DetectorWeights weights = read_weights(weights_file);
  const Model model(weights, weights_file.string());
  const TensorFile file = read_tensor_file(input);
  const NamedTensor images = read_images(file);
  const auto truth = read_truth(file, images.shape[0], model.class_count());

  HeadOutput head =
      model.forward({static_cast<int>(images.shape[0]), static_cast<int>(images.shape[2]),
                     static_cast<int>(images.shape[3]), images.values});
  const std::int64_t batch = head.batch, anchors = head.anchors(), classes = head.class_count;
  std::optional<LossValues> result;
  if (truth) result = loss(head, *truth);
  std::vector<float> predictions = decode(head);
  write_safetensors(output,
                    {{"predictions", {batch, 4 + classes, anchors}, std::move(predictions)},
                     {"box_logits", {batch, anchors, 64}, std::move(head.box)},
                     {"class_logits", {batch, anchors, classes}, std::move(head.classes)}});
  return result;
}

}  // namespace segsim::perception::yolov13
