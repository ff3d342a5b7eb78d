#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <string>

#include "checks.h"
#include "core/random.h"
#include "perception/training/internal/trainable_network.h"

namespace segsim::perception::checks {

namespace {

int failed = 0;

}  // namespace

int failures() { return failed; }

void expect_below(const std::string& what, double value, double limit) {
  const bool holds = value <= limit;  // False for a NaN.
  std::printf("%-4s %-62s %.3g (at most %.3g)\n", holds ? "ok" : "FAIL", what.c_str(), value,
              limit);
  std::fflush(stdout);
  failed += holds ? 0 : 1;
}

double largest_difference(const torch::Tensor& a, const torch::Tensor& b) {
  return (a.to(torch::kCPU, torch::kFloat64) - b.to(torch::kCPU, torch::kFloat64))
      .abs()
      .max()
      .item<double>();
}

float score_of_rank(const RawOutput& output, int64_t rank) {
  const auto sorted = std::get<0>(output.classes.sigmoid().flatten().sort(0, true));
  return sorted[rank].item<float>();
}

double worst_difference(const Candidates& a, const Candidates& b) {
  if (a.size() != b.size()) return 1e9;
  double worst = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (a[i].class_index != b[i].class_index) return 1e9;
    for (const float d :
         {a[i].box.x0 - b[i].box.x0, a[i].box.y0 - b[i].box.y0, a[i].box.x1 - b[i].box.x1,
          a[i].box.y1 - b[i].box.y1, 100.0F * (a[i].score - b[i].score)}) {
      worst = std::max(worst, std::abs(static_cast<double>(d)));
    }
  }
  return worst;
}

double median_ms(const torch::Device& device, int rounds, const std::function<void()>& work) {
  const auto wait = [&] {
    if (!device.is_cpu()) torch::cuda::synchronize();
  };
  for (int i = 0; i < 5; ++i) work();
  wait();
  std::vector<double> times_ms;
  for (int i = 0; i < rounds; ++i) {
    const auto begin = std::chrono::steady_clock::now();
    work();
    wait();
    times_ms.push_back(
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin)
            .count());
  }
  std::sort(times_ms.begin(), times_ms.end());
  return times_ms[times_ms.size() / 2];
}

DetectorWeights lively_weights(const std::string& architecture, int classes, int input_px) {
  const auto network = make_trainable_network(architecture, 0.5, classes, input_px, 7);
  DetectorWeights weights;
  weights.architecture = architecture;
  weights.width = 0.5;
  weights.input_px = input_px;
  for (int c = 0; c < classes; ++c) weights.class_names.push_back("c" + std::to_string(c));
  weights.tensors = export_tensors(*network.module);
  for (NamedTensor& tensor : weights.tensors) {
    core::RandomStream random(11, "lively/" + tensor.name);
    const auto ends = [&](const char* end) {
      const std::string& name = tensor.name;
      return name.size() >= std::strlen(end) && name.ends_with(end);
    };
    if (ends("gate") || ends("running_var")) {
      for (float& value : tensor.values) value = static_cast<float>(random.uniform(0.6, 1.4));
    } else if (ends("running_mean")) {
      for (float& value : tensor.values) value = static_cast<float>(random.uniform(-0.2, 0.2));
    }
  }
  return weights;
}

DetectorWeights lively_yolo(yolov13::Scale scale, int input_px) {
  return lively_weights(yolov13::architecture_of(scale), 80, input_px);
}

torch::Tensor noise(int batch, int side_px) {
  torch::manual_seed(5);
  return torch::rand({batch, 3, side_px, side_px});
}

RawOutput to_cpu(const NetworkOutput& output) {
  const auto& raw = std::get<RawOutput>(output);
  return {raw.box.to(torch::kCPU, torch::kFloat32),
          raw.classes.to(torch::kCPU, torch::kFloat32)};
}

std::vector<std::vector<LabeledBox>> some_truth(int batch, int classes, int side_px) {
  std::vector<std::vector<LabeledBox>> truth(static_cast<std::size_t>(batch));
  core::RandomStream random(3, "truth");
  for (auto& boxes : truth) {
    for (int i = 0; i < 6; ++i) {
      LabeledBox box;
      box.class_index = static_cast<int>(random.index(static_cast<std::uint32_t>(classes)));
      const auto at = [&](double low, double high) {
        return static_cast<float>(random.uniform(low, high) * side_px);
      };
      const float x = at(0.0, 0.6), y = at(0.0, 0.6);
      box.box = {x, y, x + at(0.1, 0.4), y + at(0.1, 0.4)};
      box.ignore = i == 5;
      boxes.push_back(box);
    }
  }
  return truth;
}

}  // namespace segsim::perception::checks
