// Branches, loops and lists.
#include "perception/models/internal/onnx/onnx_node_call.h"

namespace segsim::perception::graph {
namespace {

using at::Tensor;

/// A loop that does not end is an error, not a hang.
constexpr std::int64_t kMaxIterations = 1'000'000;

bool truth(const NodeCall& call, const Value& value) {
  if (!value.tensor.defined() || value.tensor.numel() != 1)
    call.fail("one condition", "another");
  return value.tensor.to(at::kBool).item<bool>();
}

Values branch(const NodeCall& call) {
  return call.run_graph(truth(call, call.input(0)) ? "then_branch" : "else_branch", {});
}

/// Loop: body(iteration, condition, carried...) -> condition, carried..., scanned...
Values loop(const NodeCall& call) {
  const Attribute& body = call.attribute("body");
  if (body.graph == nullptr || body.graph->inputs.size() < 2 || body.graph->outputs.empty() ||
      body.graph->outputs.size() < body.graph->inputs.size() - 1) {
    call.fail("a body with iteration and condition", "another");
  }
  const std::size_t carried = body.graph->inputs.size() - 2;
  // What the body takes from the graph around lies behind the inputs of its own.
  const std::size_t own = call.input_count() - body.graph->captures.size();
  if (own != 2 + carried) {
    call.fail(std::to_string(2 + carried) + " inputs, as the body carries " +
                  std::to_string(carried) + " values",
              std::to_string(own));
  }
  const std::size_t scanned = body.graph->outputs.size() - 1 - carried;
  const std::int64_t limit = call.has(0) ? call.integer(0) : kMaxIterations + 1;
  bool goes_on = !call.has(1) || truth(call, call.input(1));
  Values state;
  for (std::size_t i = 0; i < carried; ++i) state.push_back(call.value(2 + i));
  std::vector<std::vector<Tensor>> scans(scanned);
  for (std::int64_t k = 0; goes_on && k < limit; ++k) {
    if (k >= kMaxIterations) call.fail("at most a million iterations", "more");
    Values inputs{Value(at::scalar_tensor(k, at::kLong)),
                  Value(at::scalar_tensor(true, at::kBool))};
    inputs.insert(inputs.end(), state.begin(), state.end());
    Values results = call.run_graph("body", std::move(inputs));
    goes_on = truth(call, results[0]);
    state.assign(results.begin() + 1,
                 results.begin() + 1 + static_cast<std::ptrdiff_t>(carried));
    for (std::size_t i = 0; i < scanned; ++i)
      scans[i].push_back(results[1 + carried + i].tensor);
  }
  for (const std::vector<Tensor>& scan : scans) {
    state.emplace_back(scan.empty() ? at::zeros({0}, at::kFloat) : at::stack(scan));
  }
  return state;
}

Values sequence_construct(const NodeCall& call) { return {Value(call.tensors())}; }
Values sequence_empty(const NodeCall&) { return {Value(std::vector<Tensor>{})}; }
Values sequence_length(const NodeCall& call) {
  return {at::scalar_tensor(static_cast<std::int64_t>(call.list_input(0).size()), at::kLong)};
}

std::size_t place_in(const NodeCall& call, std::size_t input, std::size_t count) {
  const auto n = static_cast<std::int64_t>(count);
  const std::int64_t at = call.integer(input);
  if (at < -n || at >= n)
    call.fail("a place in a list of " + std::to_string(n), std::to_string(at));
  return static_cast<std::size_t>(at < 0 ? at + n : at);
}

Values sequence_at(const NodeCall& call) {
  const auto& list = call.list_input(0);
  return {list[place_in(call, 1, list.size())]};
}

Values sequence_insert(const NodeCall& call) {
  std::vector<Tensor> list = call.list_input(0);
  const std::size_t at =
      call.has(2) && call.integer(2) != static_cast<std::int64_t>(list.size())
          ? place_in(call, 2, list.size())
          : list.size();
  list.insert(list.begin() + static_cast<std::ptrdiff_t>(at), call.input(1));
  return {Value(std::move(list))};
}

Values sequence_erase(const NodeCall& call) {
  std::vector<Tensor> list = call.list_input(0);
  if (list.empty()) call.fail("a list with elements", "an empty one");
  const std::size_t at = call.has(1) ? place_in(call, 1, list.size()) : list.size() - 1;
  list.erase(list.begin() + static_cast<std::ptrdiff_t>(at));
  return {Value(std::move(list))};
}

Values concat_from_sequence(const NodeCall& call) {
  const auto& list = call.list_input(0);
  if (list.empty()) call.fail("a list with elements", "an empty one");
  const bool stacks = call.attribute_or("new_axis", 0) != 0;
  const std::int64_t axis =
      call.axis(call.attribute("axis").integer, list[0].dim() + (stacks ? 1 : 0));
  return {stacks ? at::stack(list, axis) : at::cat(list, axis)};
}

Values split_to_sequence(const NodeCall& call) {
  const Tensor& x = call.input(0);
  const std::int64_t axis = call.axis(call.attribute_or("axis", 0), x.dim());
  const bool single = !call.has(1);
  const std::int64_t each = single ? 1 : call.input(1).dim() == 0 ? call.integer(1) : 0;
  if (call.has(1) && call.input(1).dim() > 0) {
    return {Value(at::split_with_sizes(x, call.integers(1), axis))};
  }
  if (each < 1) call.fail("parts of at least 1", std::to_string(each));
  std::vector<Tensor> parts = at::split(x, each, axis);
  if (single && call.attribute_or("keepdims", 1) == 0) {
    for (Tensor& part : parts) part = part.squeeze(axis);
  }
  return {Value(std::move(parts))};
}

constexpr Operator kOperators[] = {
    {"ConcatFromSequence", 11, kLastOpset, 1, 1, "axis new_axis", concat_from_sequence},
    {"If", 1, kLastOpset, 1, 1, "then_branch else_branch", branch},
    {"Loop", 1, kLastOpset, 2, -1, "body", loop},
    {"SequenceAt", 11, kLastOpset, 2, 2, "", sequence_at},
    {"SequenceConstruct", 11, kLastOpset, 1, -1, "", sequence_construct},
    {"SequenceEmpty", 11, kLastOpset, 0, 0, "dtype", sequence_empty},
    {"SequenceErase", 11, kLastOpset, 1, 2, "", sequence_erase},
    {"SequenceInsert", 11, kLastOpset, 2, 3, "", sequence_insert},
    {"SequenceLength", 11, kLastOpset, 1, 1, "", sequence_length},
    {"SplitToSequence", 11, kLastOpset, 1, 2, "axis keepdims", split_to_sequence},
};

}  // namespace

std::span<const Operator> flow_operators() { return kOperators; }

}  // namespace segsim::perception::graph
