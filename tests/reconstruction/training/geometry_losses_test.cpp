#include "reconstruction/training/internal/geometry_losses.h"

#include <cmath>
#include <functional>
#include <vector>

#include <gmock/gmock.h>

#include "core/check.h"
#include "core/random.h"
#include "reconstruction/evaluation/image_quality.h"
#include "renderer/scene/depth_normal.h"

namespace segsim::reconstruction::internal {
namespace {

using ::testing::DoubleNear;

Tensor random_image(std::vector<std::int64_t> shape, const char* name, double lo, double hi) {
  core::RandomStream random(7, name);
  std::int64_t count = 1;
  for (const std::int64_t n : shape) count *= n;
  std::vector<double> values;
  for (std::int64_t i = 0; i < count; ++i) values.push_back(random.uniform(lo, hi));
  return device_tensor(values, torch::kFloat64, torch::kCPU).view(shape);
}

/// Largest |autograd - central differences| over some elements, in double precision.
double gradient_error(const Tensor& at, const std::function<Tensor(const Tensor&)>& loss) {
  const Tensor x = at.clone().requires_grad_(true);
  loss(x).backward();
  const Tensor by = x.grad().reshape({-1}).contiguous();
  double worst = 0.0;
  constexpr double kStep = 1e-6;
  for (std::int64_t i = 0; i < by.numel(); i += 7) {
    Tensor plus = at.clone(), minus = at.clone();
    plus.view({-1})[i] += kStep;
    minus.view({-1})[i] -= kStep;
    const double numeric =
        (loss(plus).item<double>() - loss(minus).item<double>()) / (2.0 * kStep);
    worst = std::max(worst, std::abs(numeric - by[i].item<double>()));
  }
  return worst;
}

TEST(SsimBlur, PointBecomesTheWindow) {
  Tensor image = torch::zeros({15, 17, 2});
  image[7][8][1] = 1.0F;
  const Tensor blurred = ssim_blur(image);
  double sum = 0.0;
  for (int k = -5; k <= 5; ++k) sum += std::exp(-0.5 * k * k / (1.5 * 1.5));
  for (const int dx : {0, 1, -3}) {
    for (const int dy : {0, -2, 4}) {
      const double expected = std::exp(-0.5 * (dx * dx + dy * dy) / (1.5 * 1.5)) / (sum * sum);
      EXPECT_NEAR(blurred[7 + dy][8 + dx][1].item<double>(), expected, 1e-7);
    }
  }
  EXPECT_EQ(blurred.select(2, 0).abs().sum().item<double>(), 0.0);
}

TEST(SsimBlur, FastPathEqualsConvolution) {
  const Tensor image = random_image({19, 23, 3}, "blur", -1.0, 1.0);
  const Tensor fast = ssim_blur(image.to(torch::kFloat32)).to(torch::kFloat64);
  EXPECT_LT((fast - ssim_blur(image)).abs().max().item<double>(), 1e-6);
}

TEST(Ssim, EqualsTheMetricOnImages) {
  const int width = 32, height = 20;
  core::Image<core::Rgb8> image(width, height), truth(width, height);
  core::RandomStream random(3, "ssim");
  std::vector<float> values[2];
  for (int i = 0; i < width * height; ++i) {
    const auto draw = [&] { return static_cast<std::uint8_t>(random.index(256)); };
    truth.data()[i] = {draw(), draw(), draw()};
    const auto near = [&](std::uint8_t v) {
      return static_cast<std::uint8_t>(std::min(255U, v / 2U + random.index(100)));
    };
    const core::Rgb8 t = truth.data()[i];
    image.data()[i] = {near(t.r), near(t.g), near(t.b)};
    const core::Rgb8 c = image.data()[i];
    for (const float v : {float(c.r), float(c.g), float(c.b)}) values[0].push_back(v / 255);
    for (const float v : {float(t.r), float(t.g), float(t.b)}) values[1].push_back(v / 255);
  }
  const auto tensor = [&](const std::vector<float>& v) {
    return device_tensor(v, torch::kFloat32, torch::kCPU).view({height, width, 3});
  };
  EXPECT_NEAR(ssim(tensor(values[0]), tensor(values[1])).item<double>(),
              reconstruction::ssim(image, truth), 1e-4);
  EXPECT_NEAR(ssim(tensor(values[1]), tensor(values[1])).item<double>(), 1.0, 1e-6);
}

TEST(PhotometricLoss, GradientAndMask) {
  const Tensor image = random_image({13, 12, 3}, "image", 0.0, 1.0);
  const Tensor truth = random_image({13, 12, 3}, "truth", 0.0, 1.0);
  EXPECT_LT(gradient_error(
                image, [&](const Tensor& x) { return photometric_loss(x, truth, {}, 0.2); }),
            1e-8);
  // Plain L1 by hand.
  EXPECT_NEAR(photometric_loss(image, truth, {}, 0.0).item<double>(),
              (image - truth).abs().mean().item<double>(), 1e-12);
  // Pixels that do not count have no gradient.
  Tensor valid = torch::ones({13, 12}, torch::kBool);
  valid[3][4] = false;
  const Tensor x = image.clone().requires_grad_(true);
  photometric_loss(x, truth, valid, 0.0).backward();
  EXPECT_EQ(x.grad()[3][4].abs().sum().item<double>(), 0.0);
  EXPECT_NE(x.grad()[3][5].abs().sum().item<double>(), 0.0);
}

TEST(DepthLoss, CountsSensorPixelsOnSurfaces) {
  const double nan = std::nan("");
  const auto row = [](std::vector<double> v) {
    const auto n = static_cast<std::int64_t>(v.size());
    return device_tensor(v, torch::kFloat64, torch::kCPU).view({1, n});
  };
  // Errors: 0.5 counts, 0.25 counts; then no sensor, too far, too transparent.
  const Tensor alpha = row({1.0, 0.5001, 1.0, 1.0, 0.4});
  const Tensor depth_m = row({1.5, 2.25, 3.0, 9.0, 1.0}) * alpha;
  const Tensor sensor_m = row({1.0, 2.0, nan, 20.0, 9.0});
  EXPECT_NEAR(depth_loss(depth_m, alpha, sensor_m, {}, 0.1, 10.0).item<double>(), 0.375, 1e-9);
  EXPECT_LT(gradient_error(depth_m,
                           [&](const Tensor& x) {
                             return depth_loss(x, alpha, sensor_m, {}, 0.1, 10.0);
                           }),
            1e-8);
  // Weights: of the first two pixels 3 to 1, whatever the others have.
  const Tensor weight = row({0.75, 0.25, 9.0, 9.0, 9.0});
  EXPECT_NEAR(depth_loss(depth_m, alpha, sensor_m, weight, 0.1, 10.0).item<double>(),
              0.75 * 0.5 + 0.25 * 0.25, 1e-9);
  EXPECT_LT(gradient_error(depth_m,
                           [&](const Tensor& x) {
                             return depth_loss(x, alpha, sensor_m, weight, 0.1, 10.0);
                           }),
            1e-8);
  const Tensor none = row({nan, nan, nan, nan, nan});
  EXPECT_EQ(depth_loss(depth_m, alpha, none, weight, 0.1, 10.0).item<double>(), 0.0);
  EXPECT_EQ(depth_loss(depth_m, alpha, none, {}, 0.1, 10.0).item<double>(), 0.0);
}

/// A plane z = 2 + 0.3 x seen by a turned camera.
struct TiltedPlane {
  core::CameraIntrinsics camera = core::CameraIntrinsics::from_fov(12, 10, 1.0);
  core::CameraPose T_world_camera = core::look_at({1.0, 2.0, 1.5}, {0.0, 0.0, 1.0});
  core::Image<float> image;
  Tensor depth_m, alpha, rays, normal;

  TiltedPlane() : image(12, 10) {
    std::vector<double> values;
    for (int y = 0; y < 10; ++y) {
      for (int x = 0; x < 12; ++x) {
        const glm::dvec3 ray = camera.back_project({x + 0.5, y + 0.5}, 1.0);
        values.push_back(2.0 / (1.0 - 0.3 * ray.x));
        image(x, y) = static_cast<float>(values.back());
      }
    }
    depth_m = device_tensor(values, torch::kFloat64, torch::kCPU).view({10, 12});
    alpha = torch::ones_like(depth_m);
    rays = camera_rays(camera, torch::kCPU).to(torch::kFloat64);
    // Of the surface, towards the camera.
    const glm::dvec3 n =
        T_world_camera.rotation() * (glm::dvec3(0.3, 0.0, -1.0) / std::sqrt(1.09));
    normal = device_tensor(std::vector<double>{n.x, n.y, n.z}, torch::kFloat64, torch::kCPU)
                 .expand({10, 12, 3});
  }
};

TEST(NormalConsistency, ZeroOnAPlaneWithItsOwnNormal) {
  const TiltedPlane plane;
  EXPECT_NEAR(normal_consistency(plane.normal, plane.depth_m, plane.alpha, plane.rays,
                                 plane.T_world_camera)
                  .item<double>(),
              0.0, 1e-6);
  // Away from the camera: 1 - (-1).
  EXPECT_NEAR(normal_consistency(-plane.normal, plane.depth_m, plane.alpha, plane.rays,
                                 plane.T_world_camera)
                  .item<double>(),
              2.0, 1e-6);
  const auto of_depth =
      renderer::depth_normals(plane.image, plane.camera, plane.T_world_camera);
  const Tensor n = plane.normal[5][6];
  EXPECT_NEAR(of_depth(6, 5).x, n[0].item<double>(), 1e-3);
  EXPECT_NEAR(of_depth(6, 5).z, n[2].item<double>(), 1e-3);
}

TEST(PlaneLoss, IsTheDistanceOfTheSensorsPointsFromThePlane) {
  const TiltedPlane plane;
  // The sensor saw a plane 7 cm behind, along the normal, but for one pixel.
  Tensor sensor_m = plane.depth_m * (1.0 + 0.07 * std::sqrt(1.09) / 2.0);
  const GeometryConfig::Loss config;
  const auto loss = [&](const Tensor& depth_m, const Tensor& normal) {
    return plane_loss(normal, depth_m, plane.alpha, sensor_m, plane.rays, plane.T_world_camera,
                      config);
  };
  EXPECT_NEAR(loss(plane.depth_m, plane.normal).item<double>(), 0.07, 1e-6);
  EXPECT_LT(
      gradient_error(plane.depth_m, [&](const Tensor& x) { return loss(x, plane.normal); }),
      1e-7);
  EXPECT_LT(gradient_error(plane.normal.contiguous(),
                           [&](const Tensor& x) { return loss(plane.depth_m, x); }),
            1e-7);
  // One that is 3 m off counts as 15 cm, and one without depth not at all.
  sensor_m = sensor_m.clone();
  sensor_m[3][4] += 3.0;
  sensor_m[5][6] = std::nan("");
  EXPECT_NEAR(loss(plane.depth_m, plane.normal).item<double>(), (118 * 0.07 + 0.15) / 119,
              1e-6);
}

TEST(NormalConsistency, Gradient) {
  const TiltedPlane plane;
  const Tensor bumpy = plane.depth_m + random_image({10, 12}, "bumps", -0.05, 0.05);
  const auto loss = [&](const Tensor& depth_m, const Tensor& normal) {
    return normal_consistency(normal, depth_m, plane.alpha, plane.rays, plane.T_world_camera);
  };
  EXPECT_LT(gradient_error(bumpy, [&](const Tensor& x) { return loss(x, plane.normal); }),
            1e-6);
  EXPECT_LT(gradient_error(plane.normal.contiguous(),
                           [&](const Tensor& x) { return loss(bumpy, x); }),
            1e-8);
}

TEST(Ssim, RefusesOtherSizes) {
  EXPECT_THROW((void)ssim(torch::zeros({5, 5, 3}), torch::zeros({5, 6, 3})),
               core::ContractViolation);
}

}  // namespace
}  // namespace segsim::reconstruction::internal
