// TensorFlow.js models: a JSON file with the file of weights beside it
// (perception/checkpoint/tensor_file.h).
#include "perception/checkpoint/tensor_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  const std::vector<std::string> parts = split_parts(bytes, 2);
  (void)in_file(parts[1], "model.bin");
  const perception::TensorFile file =
      perception::read_tensor_file(in_file(parts[0], "model.json"));
  for (const perception::StoredTensor& tensor : file.tensors) (void)file.read(tensor);
}

std::vector<std::string> seeds() {
  return {join_parts({R"({"format":"graph-model","weightsManifest":[{"paths":["model.bin"],
"weights":[{"name":"a","shape":[2,3],"dtype":"float32","quantization":{"dtype":"float16"}},
{"name":"b","shape":[2],"dtype":"float32"}]}]})",
                      "abcdefghijkl" + std::string(8, '\1')})};
}

}  // namespace segsim::fuzz
