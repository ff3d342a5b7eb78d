// Runs graphs node by node, and does so once at load for what is constant.
#include <algorithm>
#include <unordered_map>
#include <unordered_set>

#include "core/check.h"
#include "core/error.h"
#include "perception/models/internal/host_tensor_convert.h"
#include "perception/models/internal/onnx/onnx_node_call.h"

namespace segsim::perception::graph {
namespace {

/// Constants above this are computed when they are needed: a grown mask may be far larger than
/// the file.
constexpr std::int64_t kMaxFoldedElements = 1 << 22;

bool has_graph(const Node& node) {
  return std::any_of(node.attributes.begin(), node.attributes.end(),
                     [](const auto& entry) { return entry.second.graph != nullptr; });
}

/// Whether all inputs are known and the result is small enough to be kept.
bool is_constant(const Node& node, const Values& slots) {
  return !has_graph(node) &&
         std::all_of(node.inputs.begin(), node.inputs.end(), [&](Slot slot) {
           return slot == kNoSlot || slots[slot].tensor.defined();
         });
}

bool may_be_kept(const Values& results) {
  return std::all_of(results.begin(), results.end(), [](const Value& value) {
    return value.list == nullptr &&
           (!value.tensor.defined() || value.tensor.numel() <= kMaxFoldedElements);
  });
}

/// Fills Node::released, and drops constants that no node reads.
void find_last_uses(Graph& graph) {
  const std::unordered_set<Slot> outputs(graph.outputs.begin(), graph.outputs.end());
  std::unordered_set<Slot> seen = outputs;
  for (auto node = graph.nodes.rbegin(); node != graph.nodes.rend(); ++node) {
    node->released.clear();
    for (const std::vector<Slot>* slots : {&node->outputs, &node->inputs}) {
      for (const Slot slot : *slots) {
        if (slot != kNoSlot && seen.insert(slot).second) node->released.push_back(slot);
      }
    }
  }
  std::erase_if(graph.constants,
                [&](const auto& constant) { return !seen.contains(constant.first); });
}

}  // namespace

void fold_constants(Graph& graph, const std::string& place) {
  Values slots(graph.slot_names.size());
  for (const auto& [slot, tensor] : graph.constants) slots[slot] = tensor;
  std::vector<Node> rest;
  for (Node& node : graph.nodes) {
    bool kept = !is_constant(node, slots);
    if (!kept) {
      const Values results = execute_node(node, place, slots);
      kept = !may_be_kept(results);
      for (std::size_t i = 0; !kept && i < node.outputs.size(); ++i) {
        if (node.outputs[i] == kNoSlot || !results[i].tensor.defined()) continue;
        slots[node.outputs[i]] = results[i];
        graph.constants.emplace_back(node.outputs[i], results[i].tensor);
      }
    }
    if (!kept) continue;
    for (auto& [name, attribute] : node.attributes) {
      if (attribute.graph == nullptr) continue;
      Graph inner = *attribute.graph;
      fold_constants(inner, place);
      attribute.graph = std::make_shared<const Graph>(std::move(inner));
    }
    rest.push_back(std::move(node));
  }
  graph.nodes = std::move(rest);
  find_last_uses(graph);
}

Values execute_node(const Node& node, const std::string& place, const Values& slots) {
  const std::string where = place + ": " + node.describe();
  try {
    Values results = node.op->function(NodeCall(node, place, slots));
    if (results.size() < node.outputs.size()) {
      throw core::InputError::expected(where,
                                       std::to_string(results.size()) + " outputs at most",
                                       std::to_string(node.outputs.size()));
    }
    return results;
  } catch (const c10::Error& error) {
    throw core::InputError(where + ": " + first_line(error.what_without_backtrace()));
  } catch (const std::bad_alloc&) {
    throw core::InputError(where + ": out of memory");
  } catch (const std::length_error&) {
    throw core::InputError(where + ": out of memory");
  } catch (const core::InputError&) {
    throw;
  } catch (const core::ContractViolation&) {
    throw;
  } catch (const std::exception& error) {  // oneDNN has errors of its own.
    throw core::InputError(where + ": " + first_line(error.what()));
  }
}

Values execute(const Graph& graph, const std::string& place, Values inputs,
               const Values& around) {
  if (inputs.size() != graph.inputs.size()) {
    throw core::InputError::expected(
        place, "a graph with " + std::to_string(inputs.size()) + " inputs",
        std::to_string(graph.inputs.size()));
  }
  Values slots(graph.slot_names.size());
  for (const auto& [slot, tensor] : graph.constants) slots[slot] = tensor;
  for (const auto& [outside, inside] : graph.captures) slots[inside] = around[outside];
  for (std::size_t i = 0; i < inputs.size(); ++i)
    slots[graph.inputs[i]] = std::move(inputs[i]);
  for (const Node& node : graph.nodes) {
    Values results = execute_node(node, place, slots);
    for (std::size_t i = 0; i < node.outputs.size(); ++i) {
      if (node.outputs[i] != kNoSlot) slots[node.outputs[i]] = std::move(results[i]);
    }
    for (const Slot slot : node.released) slots[slot] = Value();
  }
  Values outputs;
  for (const Slot slot : graph.outputs) outputs.push_back(slots[slot]);
  return outputs;
}

}  // namespace segsim::perception::graph
