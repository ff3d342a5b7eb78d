#!/usr/bin/env python3
"""Makes an ONNX file of the COCO detector MobileNetV3-CenterNet in the npm package @vladmandic/human.

  npm pack @vladmandic/human@3.3.6 && tar xf vladmandic-human-3.3.6.tgz
  centernet_to_onnx.py package/models/centernet.json --out centernet.onnx [--side 512]

The package (MIT) has the network as a TensorFlow.js graph model: centernet.json, and centernet.bin beside it with
weights in float16. The operators up to the heat map and the box sizes are translated one by one; what follows in the
file (the 100 best peaks) is replaced by nodes that leave everything that is no peak at score 0. The output is that of
a YOLO, [1, 4 + 80, n] with centre and size in pixels of the input, so that whatever runs a YOLO runs this, and does
its own suppression of overlaps. The input is RGB in [0, 1], side x side.

Needs Python 3.7 and nothing else. Exit code 2 for a file that is not the known one; --any-file translates another one.
"""
import argparse
import base64
import hashlib
import json
import os
import pathlib
import struct
import sys

SHA256 = {
    "json": "bfb942eaacc5becf738d536663bc4580a0ae9e560722306e6d4dd7fe4a09de05",
    "bin": "1b635a15009071f506f9f2b3519b31c072c534888989f30d269ffd44734ef7ef",
}
COCO = """person, bicycle, car, motorcycle, airplane, bus, train, truck, boat, traffic light, fire hydrant, stop sign,
parking meter, bench, bird, cat, dog, horse, sheep, cow, elephant, bear, zebra, giraffe, backpack, umbrella, handbag,
tie, suitcase, frisbee, skis, snowboard, sports ball, kite, baseball bat, baseball glove, skateboard, surfboard,
tennis racket, bottle, wine glass, cup, fork, knife, spoon, bowl, banana, apple, sandwich, orange, broccoli, carrot,
hot dog, pizza, donut, cake, chair, couch, potted plant, bed, dining table, toilet, tv, laptop, mouse, remote,
keyboard, cell phone, microwave, oven, toaster, sink, refrigerator, book, clock, vase, scissors, teddy bear,
hair drier, toothbrush"""
NAMES = [name.strip() for name in COCO.replace("\n", " ").split(",")]
OPSET, IR_VERSION = 12, 7
FLOAT, INT64 = 1, 7  # Of TensorProto.
HEAT, SIZES = "tower_0/keypoints", "tower_0/wh"
STRIDE = 4  # Pixels of the input per cell of the heat map.


class Refused(Exception):
    pass


# ONNX files are protocol buffers: a varint (field << 3 | wire type) and the value. Numbers of fields are those of
# onnx.proto3.
def varint(number):
    number &= (1 << 64) - 1
    out = bytearray()
    while True:
        out.append(number & 127 | (128 if number > 127 else 0))
        number >>= 7
        if not number:
            return bytes(out)


def field(number, value):
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    if isinstance(value, str):
        value = value.encode()
    return varint(number << 3 | 2) + varint(len(value)) + value


def tensor(name, kind, shape, raw):
    return b"".join(field(1, side) for side in shape) + field(2, kind) + field(8, name) + field(9, raw)


def attribute(name, value):
    if isinstance(value, int):
        return field(1, name) + field(3, value) + field(20, 2)
    if isinstance(value, str):
        return field(1, name) + field(4, value) + field(20, 3)
    if isinstance(value, float):
        return field(1, name) + varint(2 << 3 | 5) + struct.pack("<f", value) + field(20, 1)
    return field(1, name) + b"".join(field(8, number) for number in value) + field(20, 7)


def value_info(name, shape):
    sides = b"".join(field(1, field(1, side)) for side in shape)
    return field(1, name) + field(2, field(1, field(1, FLOAT) + field(2, sides)))


class Graph:
    """Collects nodes and constants of an ONNX graph."""

    def __init__(self):
        self.nodes, self.tensors = [], []

    def node(self, op, inputs, output, **attributes):
        message = b"".join(field(1, name) for name in inputs)
        for name in [output] if isinstance(output, str) else output:
            message += field(2, name)
        message += field(3, "node_%d" % len(self.nodes)) + field(4, op)
        for name, value in attributes.items():
            message += field(5, attribute(name, value))
        self.nodes.append(message)

    def floats(self, name, shape, values):
        self.tensors.append(tensor(name, FLOAT, shape, struct.pack("<%df" % len(values), *values)))
        return name

    def integers(self, name, values):
        self.tensors.append(tensor(name, INT64, [len(values)], struct.pack("<%dq" % len(values), *values)))
        return name

    def model(self, name, inputs, outputs, metadata):
        graph = b"".join(field(1, node) for node in self.nodes) + field(2, name)
        graph += b"".join(field(5, one) for one in self.tensors)
        graph += b"".join(field(11, value_info(*one)) for one in inputs)
        graph += b"".join(field(12, value_info(*one)) for one in outputs)
        model = field(1, IR_VERSION) + field(2, "segsim centernet_to_onnx.py") + field(7, graph)
        model += field(8, field(2, OPSET))
        for key, value in metadata.items():
            model += field(14, field(1, key) + field(2, value))
        return model


def known(kind, content, anything):
    found = hashlib.sha256(content).hexdigest()
    if not anything and found != SHA256[kind]:
        raise Refused("centernet.%s: expected SHA-256 %s..., that of @vladmandic/human 3.3.6 (or --any-file), found %s"
                      % (kind, SHA256[kind][:16], found))


def read_weights(manifest, content):
    """Name -> (shape, values); floats are stored in half precision, integers in four bytes."""
    weights, at = {}, 0
    for entry in manifest:
        count = 1
        for side in entry["shape"]:
            count *= side
        half = entry.get("quantization", {}).get("dtype") == "float16"
        letter, size = ("e", 2) if half else ("i" if entry["dtype"] == "int32" else "f", 4)
        if at + size * count > len(content):
            raise Refused("the weights end before those of %s: expected at least %d bytes, found %d"
                          % (entry["name"], at + size * count, len(content)))
        weights[entry["name"]] = (entry["shape"], struct.unpack_from("<%d%s" % (count, letter), content, at))
        at += size * count
    if at != len(content):
        raise Refused("the weights: expected %d bytes, found %d" % (at, len(content)))
    return weights


def kernel(shape, values, depthwise):
    """[height, width, in, out] -> [out, in, height, width]; depthwise [height, width, channels, 1] -> [channels, 1, ...]."""
    h, w, first, second = shape
    if depthwise and second != 1:
        raise Refused("a depthwise kernel: expected one filter a channel, found %d" % second)
    turned = []
    for outer in range(first if depthwise else second):
        for inner in range(1 if depthwise else first):
            offset = outer if depthwise else inner * second + outer
            turned.extend(values[offset::first * second][:h * w])
    return ([first, 1, h, w] if depthwise else [second, first, h, w]), turned


def needed(nodes, outputs):
    """Nodes that the outputs depend on, each behind those that it reads."""
    order, seen = [], set()
    stack = [(name, False) for name in outputs]
    while stack:
        name, ready = stack.pop()
        if ready:
            order.append(nodes[name])
        elif name not in seen:
            seen.add(name)
            if name not in nodes:
                raise Refused("the graph: expected a node '%s', found none" % name)
            stack.append((name, True))
            stack.extend((source, False) for source in reversed(nodes[name].get("input", [])))
    return order


def convolution(graph, node, weights):
    names, attributes = node["input"], node["attr"]
    depthwise = "Depthwise" in node["op"]
    shape, values = kernel(*weights[names[1]], depthwise)
    inputs = [names[0], graph.floats(node["name"] + "/kernel", shape, values)]
    fused = [base64.b64decode(word).decode() for word in attributes.get("fused_ops", {}).get("list", {}).get("s", [])]
    if "BiasAdd" in fused:
        inputs.append(graph.floats(node["name"] + "/bias", [shape[0]], weights[names[2]][1]))
    after = [word for word in fused if word != "BiasAdd"]
    padding = base64.b64decode(attributes["padding"]["s"]).decode()
    same = padding == "SAME" or shape[2:] == [1, 1]
    if not same or len(after) > 1 or (after and after[0] not in ("Relu", "Relu6")):
        raise Refused("node %s: expected padding SAME and Relu or Relu6, found %s, %s" % (node["name"], padding, fused))
    strides = [int(number) for number in attributes["strides"]["list"]["i"][1:3]]
    inner = node["name"] + ("/linear" if after else "")
    graph.node("Conv", inputs, inner, auto_pad="SAME_UPPER", strides=strides, kernel_shape=shape[2:],
               group=shape[0] if depthwise else 1)
    if after:
        activation(graph, after[0], inner, node["name"])


def activation(graph, op, source, name):
    if op == "Relu6":
        graph.node("Clip", [source, "zero", "six"], name)
    else:
        graph.node(op, [source], name)


def translate(graph, node, weights):
    op, name, inputs = node["op"], node["name"], node.get("input", [])
    if op in ("Const", "Placeholder"):
        if name in weights and weights[name][0] == [] and isinstance(weights[name][1][0], float):
            graph.floats(name, [], weights[name][1])
    elif op in ("_FusedConv2D", "Conv2D", "FusedDepthwiseConv2dNative", "DepthwiseConv2dNative"):
        convolution(graph, node, weights)
    elif op in ("Mul", "Add"):
        graph.node(op, inputs, name)
    elif op in ("Relu", "Relu6", "Sigmoid", "Identity"):
        activation(graph, op, inputs[0], name)
    elif op == "Mean" and list(weights[inputs[1]][1]) == [1, 2]:
        graph.node("GlobalAveragePool", inputs[:1], name)
    elif op == "ConcatV2" and weights[inputs[2]][1][0] in (3, -1):
        graph.node("Concat", inputs[:2], name, axis=1)
    elif op == "ResizeBilinear":  # Here always to twice the size; corners as TensorFlow 1 had them.
        graph.node("Resize", [inputs[0], "nothing", "twice"], name, mode="linear",
                   coordinate_transformation_mode="asymmetric")
    else:
        raise Refused("node %s: expected an operator of the known network, found %s" % (name, op))


def decode(graph, side):
    """Peaks of the heat map keep their score, all else gets 0; distances to the sides become centre and size."""
    cells = side // STRIDE
    graph.node("MaxPool", [HEAT], "highest", kernel_shape=[3, 3], pads=[1, 1, 1, 1], strides=[1, 1])
    graph.node("Equal", [HEAT, "highest"], "is_peak")
    graph.node("Cast", ["is_peak"], "peak", to=FLOAT)
    graph.node("Mul", [HEAT, "peak"], "scores")
    corner = [STRIDE * x for y in range(cells) for x in range(cells)]
    corner += [STRIDE * y for y in range(cells) for x in range(cells)]
    graph.floats("corner", [1, 2, cells, cells], corner)
    graph.floats("half", [], [0.5])
    graph.node("Split", [SIZES], ["left_top", "right_bottom"], axis=1, split=[2, 2])
    graph.node("Sub", ["right_bottom", "left_top"], "shift2")
    graph.node("Mul", ["shift2", "half"], "shift")
    graph.node("Add", ["corner", "shift"], "centre")
    graph.node("Add", ["left_top", "right_bottom"], "size")
    graph.node("Concat", ["centre", "size", "scores"], "rows", axis=1)
    graph.integers("flat", [1, 4 + len(NAMES), cells * cells])
    graph.node("Reshape", ["rows", "flat"], "output0")
    return [1, 4 + len(NAMES), cells * cells]


def convert(json_file, side, anything):
    if side < 64 or side > 2048 or side % 32:
        raise Refused("--side: expected a multiple of 32 in [64, 2048], found %d" % side)
    text = json_file.read_bytes()
    known("json", text, anything)
    content = json_file.with_suffix(".bin").read_bytes()
    known("bin", content, anything)
    model = json.loads(text)
    weights = read_weights([entry for group in model["weightsManifest"] for entry in group["weights"]], content)
    nodes = {node["name"]: node for node in model["modelTopology"]["node"]}
    graph = Graph()
    for name, value in (("levels", 255.0), ("zero", 0.0), ("six", 6.0)):
        graph.floats(name, [], [value])
    graph.floats("nothing", [0], [])
    graph.floats("twice", [4], [1.0, 1.0, 2.0, 2.0])
    graph.node("Mul", ["images", "levels"], "tower_0/images")
    for node in needed(nodes, [HEAT, SIZES]):
        translate(graph, node, weights)
    rows = decode(graph, side)
    metadata = {"names": "{" + ", ".join("%d: '%s'" % pair for pair in enumerate(NAMES)) + "}",
                "imgsz": "[%d, %d]" % (side, side), "task": "detect", "stride": "32"}
    return graph.model("centernet", [("images", [1, 3, side, side])], [("output0", rows)], metadata)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("json", type=pathlib.Path, help="centernet.json, with centernet.bin beside it")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="ONNX file to write")
    parser.add_argument("--side", type=int, default=512, help="of the square input [px] (512)")
    parser.add_argument("--any-file", action="store_true", help="do not ask for the known SHA-256")
    flags = parser.parse_args()
    try:
        model = convert(flags.json, flags.side, flags.any_file)
        flags.out.parent.mkdir(parents=True, exist_ok=True)
        temporary = flags.out.with_name(flags.out.name + ".part")
        temporary.write_bytes(model)
        os.replace(temporary, flags.out)
    except (Refused, OSError, ValueError, KeyError) as error:
        print("centernet_to_onnx.py: %s" % (error if not isinstance(error, KeyError) else
                                            "%s: expected a key %s, found none" % (flags.json, error)), file=sys.stderr)
        return 2
    print("%s: %d bytes, input %d x %d" % (flags.out, len(model), flags.side, flags.side))
    return 0


if __name__ == "__main__":
    sys.exit(main())
