#include "experiments/results/training_statistics.h"
namespace segsim::experiments {
MeanInterval hierarchical_interval(std::span<const SeededValue> values, double, int, unsigned) {
  std::vector<double> v;
  for (const SeededValue& x : values) v.push_back(x.value);
  return bootstrap_mean(v, 500);
}
TrainingTest training_test(std::span<const SeededValue> d) {
  std::vector<double> v;
  for (const SeededValue& x : d) v.push_back(x.value);
  TrainingTest t; t.p = sign_flip_p(v); return t;
}
}
