/// @file
/// Compares the GPU's differentiable rasterizer with plain_rasterizer.h in float and double.
/// A test program of its own, because the machine that it runs on has no test framework. Exit
/// code 1 if a case fails, 2 without a GPU.
///
///     training_check [small]      small: for compute-sanitizer

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <memory>
#include <string>
#include <vector>

#include "core/check.h"
#include "reconstruction/rasterizer/cuda/cuda_rasterizer.h"
#include "renderer/cuda/gpu_error.h"
#include "renderer/scene/room_scene.h"
#include "tests/reconstruction/training/plain_rasterizer.h"
#include "tests/renderer/cuda_minimal/device_training.h"
#include "tests/renderer/cuda_minimal/gpu_needed.h"
#include "tests/renderer/cuda_minimal/training_compare.h"
#include "tests/renderer/scenes.h"

namespace segsim::renderer {
namespace {

using core::CameraIntrinsics;
using core::CameraPose;
using reconstruction::testing::OwnedGradients;
using reconstruction::testing::OwnedImages;
using reconstruction::testing::OwnedSurfels;
using reconstruction::testing::PlainRasterizer;
using testing::arrays_of;
using testing::DeviceGradients;
using testing::DeviceSurfels;
using testing::DeviceTrainingImages;
using testing::downloaded;
using testing::equal_bits;
using testing::relative_error;
using testing::share_off;

/// Not a multiple of the tile, principal point off the centre, pixels not square.
const CameraIntrinsics kOddCamera{77, 61, 70.0, 64.0, 36.3, 31.8};
/// Gradients by parameters may be off by this, or by three times what float loses in the plain
/// rasterizer: relative, in the Euclidean norm over all surfels.
constexpr double kTolerance = 1e-3;

struct Case {
  std::string name;
  OwnedSurfels<float> surfels;
  CameraPose pose{};
  CameraIntrinsics camera = kOddCamera;
};

template <class Real>
struct Result {
  OwnedImages<Real> images;
  OwnedGradients<Real> gradients;
  std::vector<Real> max_weight{};
};

Result<float> run_gpu(reconstruction::DifferentiableRasterizer<float>& gpu, const Case& c,
                      const OwnedImages<float>& loss, int backward_calls = 1) {
  const DeviceSurfels surfels(c.surfels);
  const DeviceTrainingImages images(c.camera), device_loss(loss);
  const DeviceGradients gradients(surfels);
  Result<float> result{OwnedImages<float>(c.camera), OwnedGradients<float>(c.surfels)};
  gpu.forward(surfels.view(), c.camera, c.pose, images.view(), gradients.max_weight.data());
  for (int i = 0; i < backward_calls; ++i) {
    gpu.backward(surfels.view(), device_loss.view<const float>(), gradients.view());
  }
  images.download(result.images);
  gradients.download(result.gradients);
  result.max_weight = downloaded(gradients.max_weight.data(), gradients.max_weight.size());
  return result;
}

struct Report {
  int failed = 0;
  void expect(bool holds, const std::string& what) {
    if (holds) return;
    ++failed;
    std::printf("    FAILED: %s\n", what.c_str());
  }
};

using Rows = std::vector<std::vector<PlainRasterizer<double>::Weight>>;

/// Rows for some pixels, in any order, all entries and the heaviest three.
void check_weights(reconstruction::DifferentiableRasterizer<float>& gpu, const Rows& reference,
                   const Case& c, Report& report) {
  std::vector<std::int32_t> pixels;
  const auto area = static_cast<std::int32_t>(reference.size());
  for (std::int32_t i = 0; i < area; ++i) pixels.push_back((i * 7 + 3) % area);
  const auto device_pixels = testing::uploaded(pixels);
  const auto read = [&](int most, std::vector<std::int32_t>& start,
                        std::vector<std::int32_t>& surfel, std::vector<float>& weight) {
    const reconstruction::PixelWeights w = gpu.weights(device_pixels.data(), area, most);
    start = downloaded(w.row_start, static_cast<std::size_t>(w.pixels) + 1);
    surfel = downloaded(w.surfel, static_cast<std::size_t>(w.entries));
    weight = downloaded(w.weight, static_cast<std::size_t>(w.entries));
    report.expect(start.front() == 0 && start.back() == w.entries, "rows end at the entries");
  };
  std::vector<std::int32_t> start, surfel, top_start, top_surfel;
  std::vector<float> weight, top_weight;
  read(0, start, surfel, weight);
  constexpr int kMost = 3;
  read(kMost, top_start, top_surfel, top_weight);
  std::size_t entries = 0, off = 0, top_off = 0;
  for (std::size_t p = 0; p < pixels.size(); ++p) {
    const auto& row = reference[static_cast<std::size_t>(pixels[p])];
    const auto first = static_cast<std::size_t>(start[p]);
    const auto size = static_cast<std::size_t>(start[p + 1]) - first;
    entries += row.size();
    if (size != row.size()) {
      off += std::max(size, row.size());
    } else {
      for (std::size_t i = 0; i < size; ++i) {
        off +=
            surfel[first + i] != row[i].surfel ||
                    !(std::abs(static_cast<double>(weight[first + i]) - row[i].weight) <= 1e-4)
                ? 1U
                : 0U;
      }
    }
    // The heaviest of the row that the device itself returned: exactly.
    std::vector<std::size_t> kept(size);
    for (std::size_t i = 0; i < size; ++i) kept[i] = first + i;
    std::sort(kept.begin(), kept.end(), [&](std::size_t a, std::size_t b) {
      return weight[a] != weight[b] ? weight[a] > weight[b] : surfel[a] < surfel[b];
    });
    if (size > kMost) kept.resize(kMost);
    std::sort(kept.begin(), kept.end());
    const auto top_first = static_cast<std::size_t>(top_start[p]);
    if (static_cast<std::size_t>(top_start[p + 1]) - top_first != kept.size()) {
      ++top_off;
      continue;
    }
    for (std::size_t i = 0; i < kept.size(); ++i) {
      top_off += top_surfel[top_first + i] != surfel[kept[i]] ||
                         top_weight[top_first + i] != weight[kept[i]]
                     ? 1U
                     : 0U;
    }
  }
  std::printf("    weights: %zu entries, %zu off; heaviest %d: %zu off\n", entries, off, kMost,
              top_off);
  report.expect(static_cast<double>(off) <= 2e-3 * static_cast<double>(entries) + 2.0,
                c.name + ": weights");
  report.expect(top_off == 0, c.name + ": heaviest weights");
}

/// @param gpu  Has drawn other views before.
/// @return  Failures.
int check_case(const Case& c, reconstruction::DifferentiableRasterizer<float>& gpu,
               reconstruction::DifferentiableRasterizer<float>& fixed_order, bool zero_loss) {
  Report report;
  OwnedImages<double> loss = reconstruction::testing::random_loss<double>(3, c.camera);
  OwnedImages<float> loss_f(c.camera);
  const auto narrow = [&](std::vector<double>& from, std::vector<float>& to) {
    if (zero_loss) std::fill(from.begin(), from.end(), 0.0);
    for (std::size_t i = 0; i < from.size(); ++i) {
      to[i] = static_cast<float>(from[i]);
      from[i] = static_cast<double>(to[i]);
    }
  };
  narrow(loss.rgb, loss_f.rgb), narrow(loss.depth_m, loss_f.depth_m);
  narrow(loss.alpha, loss_f.alpha), narrow(loss.normal, loss_f.normal);
  narrow(loss.distortion, loss_f.distortion);

  const OwnedSurfels<double> exact = reconstruction::testing::converted<double>(c.surfels);
  Result<double> reference{OwnedImages<double>(c.camera), OwnedGradients<double>(exact)};
  Rows rows;
  PlainRasterizer<double>(exact, c.camera, c.pose)
      .run(loss, reference.images, reference.gradients, reference.max_weight, rows);
  Result<float> plain{OwnedImages<float>(c.camera), OwnedGradients<float>(c.surfels)};
  std::vector<std::vector<PlainRasterizer<float>::Weight>> plain_rows;
  PlainRasterizer<float>(c.surfels, c.camera, c.pose)
      .run(loss_f, plain.images, plain.gradients, plain.max_weight, plain_rows);

  const Result<float> result = run_gpu(gpu, c, loss_f, 2);
  std::printf("%-24s %zu surfels\n    images, share off by 1e-4:", c.name.c_str(),
              c.surfels.opacity_logit.size());
  const auto images = arrays_of<std::vector<float>>(result.images);
  const auto exact_images = arrays_of<std::vector<double>>(reference.images);
  for (std::size_t i = 0; i < images.size(); ++i) {
    const double off = share_off(*images[i].second, *exact_images[i].second, 1e-4);
    std::printf(" %s %.1e", images[i].first, off);
    report.expect(off <= 2e-3, c.name + ": " + images[i].first);
  }
  const double off = share_off(result.max_weight, reference.max_weight, 1e-4);
  std::printf(" max_weight %.1e\n    gradients (plain float):", off);
  report.expect(off <= 5e-3, c.name + ": max_weight");
  const auto gradients = arrays_of<std::vector<float>>(result.gradients);
  const auto exact_gradients = arrays_of<std::vector<double>>(reference.gradients);
  const auto plain_gradients = arrays_of<std::vector<float>>(plain.gradients);
  for (std::size_t i = 0; i < gradients.size(); ++i) {
    const double error = relative_error(*gradients[i].second, *exact_gradients[i].second);
    const double lost = relative_error(*plain_gradients[i].second, *exact_gradients[i].second);
    std::printf(" %s %.1e (%.1e)", gradients[i].first, error, lost);
    report.expect(error <= std::max(kTolerance, 3.0 * lost),
                  c.name + ": gradient " + gradients[i].first);
  }
  std::printf("\n");
  check_weights(gpu, rows, c, report);

  const Result<float> once = run_gpu(fixed_order, c, loss_f);
  const auto another = reconstruction::make_cuda_rasterizer({.deterministic = true});
  const Result<float> again = run_gpu(*another, c, loss_f, 2);
  const auto a = arrays_of<std::vector<float>>(once.gradients);
  const auto b = arrays_of<std::vector<float>>(again.gradients);
  for (std::size_t i = 0; i < a.size(); ++i) {
    report.expect(equal_bits(*a[i].second, *b[i].second),
                  c.name + ": repeatable gradient " + a[i].first);
    const double error = relative_error(*a[i].second, *exact_gradients[i].second);
    const double lost = relative_error(*plain_gradients[i].second, *exact_gradients[i].second);
    report.expect(error <= std::max(kTolerance, 3.0 * lost),
                  c.name + ": gradient in fixed order " + a[i].first);
  }
  const auto first = arrays_of<std::vector<float>>(once.images);
  const auto second = arrays_of<std::vector<float>>(result.images);
  for (std::size_t i = 0; i < first.size(); ++i) {
    report.expect(equal_bits(*first[i].second, *second[i].second),
                  c.name + ": repeatable " + first[i].first);
  }
  report.expect(equal_bits(once.max_weight, result.max_weight),
                c.name + ": repeatable max_weight");
  return report.failed;
}

/// @param small  Without the large ones, for slow tools.
std::vector<Case> make_cases(bool small) {
  std::vector<Case> cases;
  for (const int degree : {0, 1, 2, 3}) {
    cases.push_back(
        {"random, degree " + std::to_string(degree),
         reconstruction::testing::random_surfels<float>(11 + degree, 600, degree)});
  }
  OwnedSurfels<float> part = reconstruction::testing::random_surfels<float>(21, 600, 3);
  part.active_sh_degree = 1;
  cases.push_back({"degree 1 of 3", part});
  cases.push_back({"no surfels", {}});
  cases.push_back(
      {"inside",
       reconstruction::testing::parameters_of<float>(testing::random_scene(10, 1500)),
       core::look_at({0.1, 0.2, -0.1}, {1.0, 0.3, 0.2})});
  const CameraIntrinsics narrow{40, 36, 60.0, 60.0, 20.0, 18.0};
  cases.push_back({"stack of 3000",
                   reconstruction::testing::parameters_of<float>(testing::stack(3000, 0.05F)),
                   CameraPose(), narrow});
  if (!small) {
    cases.push_back(
        {"stack of 12000",
         reconstruction::testing::parameters_of<float>(testing::stack(12000, 0.02F)),
         CameraPose(), narrow});
    cases.push_back({"ties",
                     reconstruction::testing::parameters_of<float>(testing::ties(5000)),
                     CameraPose(), narrow});
    RoomSceneOptions room;
    room.surfel_count = 60'000;
    room.spread = 1.6;
    cases.push_back({"room",
                     reconstruction::testing::parameters_of<float>(make_room_scene(room)),
                     room_camera_ring(8)[3], room_camera(324, 242)});
  }
  OwnedSurfels<float> broken = reconstruction::testing::random_surfels<float>(31, 300, 0);
  cases.push_back({"some not numbers", broken});
  return cases;
}

/// Parameters that are not numbers: the surfel is not drawn, and nothing else suffers.
int check_not_numbers(const Case& c, reconstruction::DifferentiableRasterizer<float>& gpu) {
  Report report;
  const OwnedImages<float> loss = reconstruction::testing::random_loss<float>(4, c.camera);
  Case broken = c, removed = c;
  for (std::size_t i = 0; i < c.surfels.opacity_logit.size(); i += 5) {
    std::vector<float>* const arrays[] = {&broken.surfels.position_m,
                                          &broken.surfels.log_scale, &broken.surfels.rotation,
                                          &broken.surfels.opacity_logit};
    std::vector<float>& array = *arrays[i / 5 % 4];
    array[i * (array.size() / c.surfels.opacity_logit.size())] = NAN;
    removed.surfels.opacity_logit[i] = -20.0F;
  }
  const Result<float> a = run_gpu(gpu, broken, loss), b = run_gpu(gpu, removed, loss);
  const auto x = arrays_of<std::vector<float>>(a.images);
  const auto y = arrays_of<std::vector<float>>(b.images);
  for (std::size_t i = 0; i < x.size(); ++i) {
    report.expect(equal_bits(*x[i].second, *y[i].second),
                  std::string("not numbers: ") + x[i].first);
  }
  for (const auto& [name, values] : arrays_of<std::vector<float>>(a.gradients)) {
    for (const float v : *values) {
      if (std::isfinite(v)) continue;
      report.expect(false, std::string("not numbers: gradient ") + name);
      break;
    }
  }
  return report.failed;
}

/// Images that the loss does not look at may be null.
int check_missing_images(const Case& c, reconstruction::DifferentiableRasterizer<float>& gpu) {
  Report report;
  OwnedImages<float> loss = reconstruction::testing::random_loss<float>(5, c.camera);
  for (auto* image : {&loss.depth_m, &loss.alpha, &loss.normal, &loss.distortion}) {
    std::fill(image->begin(), image->end(), 0.0F);
  }
  const DeviceSurfels surfels(c.surfels);
  const DeviceTrainingImages images(c.camera), device_loss(loss);
  const DeviceGradients gradients(surfels), with_zeros(surfels);
  reconstruction::TrainingImages<float> drawn = images.view();
  drawn.distortion = nullptr;
  gpu.forward(surfels.view(), c.camera, c.pose, drawn, nullptr);
  reconstruction::TrainingImages<const float> only_rgb{};
  only_rgb.width_px = c.camera.width_px, only_rgb.height_px = c.camera.height_px;
  only_rgb.rgb = device_loss.rgb.data();
  reconstruction::SurfelGradients<float> without_screen = gradients.view();
  without_screen.screen = without_screen.max_weight = nullptr;
  gpu.backward(surfels.view(), only_rgb, without_screen);
  gpu.backward(surfels.view(), device_loss.view<const float>(), with_zeros.view());
  const auto a = downloaded(gradients.sh.data(), gradients.sh.size());
  const auto b = downloaded(with_zeros.sh.data(), with_zeros.sh.size());
  report.expect(relative_error(a, std::vector<double>(b.begin(), b.end())) < 1e-5,
                "images left out count as zero");
  return report.failed;
}

template <class Call>
bool refuses(const Call& call) {
  try {
    call();
  } catch (const core::ContractViolation&) {
    return true;
  }
  return false;
}

int check_contract(const Case& c) {
  Report report;
  const auto gpu = reconstruction::make_cuda_rasterizer();
  const DeviceSurfels surfels(c.surfels);
  const DeviceTrainingImages images(c.camera);
  const DeviceGradients gradients(surfels);
  const auto pixels = testing::uploaded(std::vector<std::int32_t>{0, 5, 77 * 61});
  report.expect(refuses([&] { static_cast<void>(gpu->weights(pixels.data(), 2, 0)); }),
                "weights() before forward() is refused");
  report.expect(refuses([&] {
                  gpu->backward(surfels.view(), images.view<const float>(), gradients.view());
                }),
                "backward() before forward() is refused");
  reconstruction::TrainingImages<float> missing = images.view();
  missing.rgb = nullptr;
  report.expect(
      refuses([&] { gpu->forward(surfels.view(), c.camera, c.pose, missing, nullptr); }),
      "an image that is null is refused");
  gpu->forward(surfels.view(), c.camera, c.pose, images.view(), nullptr);
  report.expect(!refuses([&] { static_cast<void>(gpu->weights(pixels.data(), 2, 0)); }),
                "pixels of the image are accepted");
  report.expect(refuses([&] { static_cast<void>(gpu->weights(pixels.data(), 3, 0)); }),
                "pixels outside the image are refused");
  return report.failed;
}

int run_all(bool small) {
  const auto gpu = reconstruction::make_cuda_rasterizer();
  const auto fixed_order = reconstruction::make_cuda_rasterizer({.deterministic = true});
  int failed = 0;
  const std::vector<Case> cases = make_cases(small);
  for (const Case& c : cases) failed += check_case(c, *gpu, *fixed_order, false);
  failed += check_case(cases[0], *gpu, *fixed_order, true);
  failed += check_not_numbers(cases.back(), *gpu);
  failed += check_missing_images(cases[3], *gpu);
  failed += check_contract(cases[0]);
  std::printf("%d failed\n", failed);
  return failed == 0 ? 0 : 1;
}

}  // namespace
}  // namespace segsim::renderer

/// @return  0 if all is well, 1 if not; exit_code_without_gpu() if there is no GPU to ask.
int main(int argc, char**) {
  using namespace segsim::renderer;
  try {
    (void)segsim::reconstruction::make_cuda_rasterizer();
  } catch (const GpuError& error) {
    return exit_code_without_gpu("training_check", error.what());
  }
  try {
    return run_all(argc > 1);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "training_check: %s\n", error.what());
    return 1;
  }
}
