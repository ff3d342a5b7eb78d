#include "perception/internal/network/training_norm.h"

#include <vector>

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "core/process/kernel_choice.h"

namespace segsim::perception {
namespace {

struct Step {
  torch::Tensor out, x_gradient, weight_gradient, bias_gradient, mean, var, batches;
};

/// One pass forward and backward through a norm of given state.
template <typename Apply>
Step step(const torch::Tensor& x, const torch::Tensor& weight,
          const torch::Tensor& out_gradient, bool training, const Apply& apply) {
  torch::nn::BatchNorm2d norm(
      torch::nn::BatchNorm2dOptions(x.size(1)).eps(1e-3).momentum(0.03));
  torch::NoGradGuard none;
  norm->weight.copy_(weight);
  norm->bias.copy_(weight.flip(0) - 1.0);
  norm->running_mean.copy_(0.3 * weight);
  norm->running_var.copy_(weight);
  norm->train(training);
  torch::AutoGradMode gradients(true);
  const torch::Tensor input = x.detach().clone().requires_grad_(true);
  const torch::Tensor out = apply(norm, input);
  out.backward(out_gradient);
  return {out.detach(),       input.grad(),      norm->weight.grad(),      norm->bias.grad(),
          norm->running_mean, norm->running_var, norm->num_batches_tracked};
}

void expect_same_bits(const Step& ours, const Step& theirs) {
  EXPECT_TRUE(torch::equal(ours.out, theirs.out));
  EXPECT_TRUE(torch::equal(ours.x_gradient, theirs.x_gradient));
  EXPECT_TRUE(torch::equal(ours.weight_gradient, theirs.weight_gradient));
  EXPECT_TRUE(torch::equal(ours.bias_gradient, theirs.bias_gradient));
  EXPECT_TRUE(torch::equal(ours.mean, theirs.mean));
  EXPECT_TRUE(torch::equal(ours.var, theirs.var));
  EXPECT_TRUE(torch::equal(ours.batches, theirs.batches));
}

const auto kOurs = [](torch::nn::BatchNorm2d& norm, const torch::Tensor& x) {
  return apply_norm(norm, x);
};
const auto kTheirs = [](torch::nn::BatchNorm2d& norm, const torch::Tensor& x) {
  return norm(x);
};

class TrainingNorm : public testing::Test {
 protected:
  void SetUp() override {
    if (!core::can_be_reproducible()) GTEST_SKIP() << "no AVX2 here: libtorch's norm is used";
    torch::manual_seed(7);
  }
};

TEST_F(TrainingNorm, HasTheBitsOfLibtorch) {
  // Channels in eights and others, planes that no vector divides, few values, far from zero.
  const std::vector<std::vector<std::int64_t>> shapes{{4, 16, 24, 32}, {1, 8, 1, 2},
                                                      {2, 8, 1, 1},    {3, 13, 7, 9},
                                                      {1, 40, 5, 5},   {8, 1, 3, 11}};
  for (const auto& shape : shapes) {
    for (const double offset : {0.0, 100.0}) {
      const torch::Tensor x = torch::randn(shape) * 3.0 + offset;
      const torch::Tensor weight = torch::rand({shape[1]}) + 0.5;
      const torch::Tensor gradient = torch::randn(shape);
      SCOPED_TRACE(testing::Message() << x.sizes() << " + " << offset);
      expect_same_bits(step(x, weight, gradient, true, kOurs),
                       step(x, weight, gradient, true, kTheirs));
    }
  }
}

TEST_F(TrainingNorm, ThreadsDoNotMatter) {
  const torch::Tensor x = torch::randn({2, 37, 9, 10});
  const torch::Tensor weight = torch::rand({37}) + 0.5, gradient = torch::randn_like(x);
  const int threads = torch::get_num_threads();
  torch::set_num_threads(1);
  const Step one = step(x, weight, gradient, true, kOurs);
  torch::set_num_threads(3);
  const Step three = step(x, weight, gradient, true, kOurs);
  torch::set_num_threads(threads);
  expect_same_bits(three, one);
}

TEST_F(TrainingNorm, LeavesTheRestToLibtorch) {
  const torch::Tensor weight = torch::rand({6}) + 0.5;
  const torch::Tensor x = torch::randn({2, 6, 8, 8}), gradient = torch::randn_like(x);
  expect_same_bits(step(x, weight, gradient, false, kOurs),
                   step(x, weight, gradient, false, kTheirs));
  torch::nn::BatchNorm2d plain(torch::nn::BatchNorm2dOptions(6).affine(false));
  torch::nn::BatchNorm2d forgetful(
      torch::nn::BatchNorm2dOptions(6).track_running_stats(false));
  for (torch::nn::BatchNorm2d norm : {plain, forgetful}) {
    EXPECT_TRUE(torch::equal(apply_norm(norm, x), norm(x)));
  }
  torch::nn::BatchNorm2d narrow(torch::nn::BatchNorm2dOptions(5));
  EXPECT_THROW((void)apply_norm(narrow, x), c10::Error);
  const torch::Tensor last = x.contiguous(torch::MemoryFormat::ChannelsLast);
  expect_same_bits(step(last, weight, gradient, true, kOurs),
                   step(last, weight, gradient, true, kTheirs));
}

}  // namespace
}  // namespace segsim::perception
