#include "reconstruction/internal/tensors/adam.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "core/error.h"
#include "core/file_io.h"
#include "tests/reconstruction/training/finite_differences.h"

namespace segsim::reconstruction {
namespace {

using internal::AdamTensor;
using internal::StateReader;
using internal::StateWriter;
namespace fs = std::filesystem;

/// Adam of one number, from the paper's Algorithm 1.
struct OneNumber {
  double value, m = 0.0, v = 0.0;
  int t = 0;
  void step(double g, double rate) {
    ++t;
    m = 0.9 * m + 0.1 * g;
    v = 0.999 * v + 0.001 * g * g;
    value -= rate * (m / (1.0 - std::pow(0.9, t))) /
             (std::sqrt(v / (1.0 - std::pow(0.999, t))) + 1e-8);
  }
};

at::Tensor rows_of(const std::vector<std::int64_t>& rows) {
  return internal::device_tensor(rows, torch::kInt64, torch::kCPU);
}

TEST(LabelAdam, EveryRowFollowsThePapersAlgorithmAndCountsItsOwnSteps) {
  // float takes the loops over rows, double the path of other devices.
  for (const auto type : {torch::kFloat32, torch::kFloat64}) {
    AdamTensor adam(testing::random_tensor({5, 3}, 1).to(type));
    std::vector<OneNumber> expected;
    for (std::int64_t i = 0; i < 15; ++i) {
      expected.push_back({adam.value()[i / 3][i % 3].item<double>()});
    }
    const std::vector<std::vector<std::int64_t>> batches{
        {0, 3}, {3}, {1, 3, 4}, {0, 1}, {3, 4}};
    for (std::size_t b = 0; b < batches.size(); ++b) {
      const auto count = static_cast<std::int64_t>(batches[b].size());
      const at::Tensor g = testing::random_tensor({count, 3}, 2 + b).to(type);
      adam.step_rows(rows_of(batches[b]), g, 0.1);
      for (std::int64_t i = 0; i < count; ++i) {
        for (std::int64_t k = 0; k < 3; ++k) {
          const std::int64_t row = batches[b][static_cast<std::size_t>(i)];
          expected[static_cast<std::size_t>(row * 3 + k)].step(g[i][k].item<double>(), 0.1);
        }
      }
    }
    for (std::int64_t i = 0; i < 15; ++i) {
      EXPECT_NEAR(adam.value()[i / 3][i % 3].item<double>(),
                  expected[static_cast<std::size_t>(i)].value, 1e-6);
    }
  }
}

TEST(LabelAdam, AWholeStepIsAStepOfAllRows) {
  const at::Tensor start = testing::random_tensor({4, 2}, 1).to(torch::kFloat32);
  const at::Tensor g = testing::random_tensor({4, 2}, 2).to(torch::kFloat32);
  AdamTensor whole(start.clone()), rows(start.clone());
  whole.step(g, 0.05);
  rows.step_rows(rows_of({3, 2, 1, 0}), g.flip(0), 0.05);
  EXPECT_TRUE(torch::equal(whole.value(), rows.value()));
}

class StateFile : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    file_ = fs::path(::testing::TempDir()) / (std::string("state_") + info->name());
  }
  void TearDown() override { fs::remove(file_); }
  void write() const {
    AdamTensor adam(testing::random_tensor({4, 2}, 1).to(torch::kFloat32));
    StateWriter out("a head");
    adam.save(out, "x");
    out.put_integers("counts", {3, -1});
    out.write(file_);
  }
  fs::path file_;
};

TEST_F(StateFile, AdamGoesOnAsIfItHadNotStopped) {
  const at::Tensor start = testing::random_tensor({4, 2}, 1).to(torch::kFloat32);
  AdamTensor through(start.clone()), stopped(start.clone());
  const auto gradient = [](std::uint64_t seed) {
    return testing::random_tensor({2, 2}, seed).to(torch::kFloat32);
  };
  for (auto* adam : {&through, &stopped}) adam->step_rows(rows_of({0, 2}), gradient(2), 0.1);
  StateWriter out("a head");
  stopped.save(out, "x");
  out.write(file_);
  AdamTensor resumed(torch::zeros({4, 2}));
  resumed.load(StateReader(file_, "a head"), "x");
  for (auto* adam : {&through, &resumed}) adam->step_rows(rows_of({2, 3}), gradient(3), 0.1);
  EXPECT_TRUE(torch::equal(through.value(), resumed.value()));
}

TEST_F(StateFile, BadFilesAreRefused) {
  write();
  EXPECT_EQ(StateReader(file_, "a head").integers("counts"),
            (std::vector<std::int64_t>{3, -1}));
  EXPECT_THROW(StateReader(file_, "another head"), core::InputError);
  EXPECT_THROW(StateReader(fs::path("/nowhere/state"), "a head"), core::InputError);
  const StateReader in(file_, "a head");
  EXPECT_THROW(static_cast<void>(in.integers("x")), core::InputError);
  EXPECT_THROW(static_cast<void>(in.take("y", torch::zeros({4, 2}))), core::InputError);
  EXPECT_THROW(static_cast<void>(in.take("x", torch::zeros({4, 3}))), core::InputError);
  EXPECT_THROW(static_cast<void>(in.take("x", torch::zeros({4, 2}, torch::kFloat64))),
               core::InputError);
  EXPECT_THROW(in.expect_rows("x", 5), core::InputError);
  const std::string good = core::read_file(file_);
  for (const std::size_t at : {std::size_t{2}, std::size_t{40}, good.size() / 2}) {
    std::string damaged = good;
    damaged[at] = static_cast<char>(damaged[at] ^ 1);
    std::ofstream(file_, std::ios::binary) << damaged;
    EXPECT_THROW(StateReader(file_, "a head"), core::InputError) << at;
  }
  std::ofstream(file_, std::ios::binary) << good.substr(0, good.size() / 2);
  EXPECT_THROW(StateReader(file_, "a head"), core::InputError);
}

}  // namespace
}  // namespace segsim::reconstruction
