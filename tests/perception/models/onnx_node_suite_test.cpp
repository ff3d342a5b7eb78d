// The standard's own node tests: folders with model.onnx and
// test_data_set_0/{input,output}_N.pb, as the onnx project generates them. They are large and
// not part of this repository:
//     SEGSIM_ONNX_NODE_TESTS=onnx/backend/test/data/node ctest -R onnx_node_suite
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <map>

#include "core/error.h"
#include "perception/models/internal/host_tensor_convert.h"
#include "perception/models/internal/onnx/onnx_tensor.h"
#include "perception/models/model_session.h"
#include "tests/perception/onnx_builder.h"

namespace segsim::perception {
namespace {

namespace fs = std::filesystem;

HostTensor read_host_tensor(const fs::path& file) {
  ::onnx::TensorProto proto;
  std::ifstream stream(file, std::ios::binary);
  if (!proto.ParseFromIstream(&stream)) throw core::InputError(file.string() + ": no tensor");
  return to_host_tensor(graph::read_tensor(proto, file.parent_path(), file.string()));
}

bool nearly_equal(const HostTensor& a, const HostTensor& b) {
  if (a.shape != b.shape || a.values.index() != b.values.index()) return false;
  if (std::holds_alternative<Ints>(a.values)) return a.integers() == b.integers();
  return std::equal(a.floats().begin(), a.floats().end(), b.floats().begin(),
                    [](float x, float y) {
                      if (std::isnan(x) || std::isnan(y))
                        return std::isnan(x) && std::isnan(y);
                      return x == y || std::abs(x - y) <= 1e-5F + 1e-3F * std::abs(y);
                    });
}

/// "ok", "refused: ..." (a clear message instead of a result) or "wrong: ...".
std::string run_case(const fs::path& folder) {
  try {
    const auto session = open_model(folder / "model.onnx");
    std::map<std::string, HostTensor> inputs;
    for (std::size_t i = 0; i < session->inputs().size(); ++i) {
      inputs[session->inputs()[i].name] = read_host_tensor(
          folder / "test_data_set_0" / ("input_" + std::to_string(i) + ".pb"));
    }
    const auto outputs = session->run(inputs);
    for (std::size_t i = 0; i < outputs.size(); ++i) {
      const HostTensor expected = read_host_tensor(folder / "test_data_set_0" /
                                                   ("output_" + std::to_string(i) + ".pb"));
      if (!nearly_equal(outputs[i].tensor, expected)) {
        return "wrong: output " + std::to_string(i) + " " +
               shape_text(outputs[i].tensor.shape) + " for " + shape_text(expected.shape);
      }
    }
    return "ok";
  } catch (const core::InputError& error) {
    return std::string("refused: ") + error.what();
  }
}

TEST(OnnxNodeSuite, AgreesOrSaysWhatIsMissing) {
  const char* folder = std::getenv("SEGSIM_ONNX_NODE_TESTS");
  if (folder == nullptr) GTEST_SKIP() << "SEGSIM_ONNX_NODE_TESTS is not set";
  int passed = 0, refused = 0, wrong = 0;
  std::map<std::string, int> missing;
  std::vector<fs::path> cases;
  for (const auto& entry : fs::directory_iterator(folder)) cases.push_back(entry.path());
  std::sort(cases.begin(), cases.end());
  for (const fs::path& path : cases) {
    const std::string result = run_case(path);
    passed += result == "ok" ? 1 : 0;
    refused += result.starts_with("refused") ? 1 : 0;
    if (result != "ok") std::printf("%s: %s\n", path.filename().c_str(), result.c_str());
    if (result.starts_with("wrong")) ++wrong;
  }
  std::printf("%d agree, %d refused, %d wrong\n", passed, refused, wrong);
  EXPECT_GT(passed, 0);
  EXPECT_EQ(wrong, 0);
}

}  // namespace
}  // namespace segsim::perception
