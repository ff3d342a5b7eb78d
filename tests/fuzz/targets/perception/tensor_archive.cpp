// Weights of others: .pt (zip and pickle), TorchScript, safetensors
// (perception/checkpoint/tensor_file.h). Every tensor is read as well.
#include "perception/checkpoint/tensor_file.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/perception/checkpoint_writer.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  const perception::TensorFile file = perception::read_tensor_file(in_file(bytes, "w.pt"));
  for (const perception::StoredTensor& tensor : file.tensors) (void)file.read(tensor);
}

std::vector<std::string> seeds() {
  const std::vector<perception::NamedTensor> tensors = {
      {"a.weight", {2, 3}, {1, 2, 3, 4, 5, 6}}, {"a.bias", {2}, {0.5F, -1.0F}}};
  return {perception::make_state_dict_file(tensors, true),
          perception::make_state_dict_file(tensors, false),
          perception::make_safetensors_file(tensors, true),
          perception::make_safetensors_file(tensors, false)};
}

}  // namespace segsim::fuzz
