// The table of all operators.
#include <algorithm>
#include <map>

#include "perception/models/internal/onnx/onnx_node_call.h"

namespace segsim::perception::graph {
namespace {

const std::map<std::string_view, const Operator*>& table() {
  static const auto operators = [] {
    std::map<std::string_view, const Operator*> all;
    for (const auto& group :
         {elementwise_operators(), shape_operators(), index_operators(), window_operators(),
          norm_operators(), reduce_operators(), matrix_operators(), resample_operators(),
          region_operators(), flow_operators()}) {
      for (const Operator& op : group) all.emplace(op.name, &op);
    }
    return all;
  }();
  return operators;
}

}  // namespace

const Operator* find_operator(std::string_view name) {
  const auto found = table().find(name);
  return found == table().end() ? nullptr : found->second;
}

std::vector<std::string> operator_names() {
  std::vector<std::string> names;
  for (const auto& [name, op] : table()) names.emplace_back(name);
  return names;
}

}  // namespace segsim::perception::graph
