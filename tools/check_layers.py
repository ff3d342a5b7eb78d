#!/usr/bin/env python3
"""Fails when a file includes a folder or a library that its own folder may not use.

  check_layers.py ROOT           one line for every violation; exit code 1 if there is any
  check_layers.py ROOT --graph   which room includes which, module by module, and how many files each has

The tables below are the architecture; docs/architecture.md draws them.
"""
import collections
import pathlib
import re
import sys

MAY_INCLUDE = {  # module: the folders of other modules that its files may include
    "core": (),
    "renderer": ("core",),
    "perception": ("core",),
    "nav": ("core",),
    "sim": ("core",),
    "ros": ("core",),
    "peers": ("core",),
    "reconstruction": ("core", "renderer"),
    "worlds": ("core", "sim/ground"),
    "experiments": ("core", "renderer", "reconstruction", "perception", "nav", "sim", "ros", "peers", "worlds"),
    "python": ("core", "renderer", "reconstruction/rasterizer", "sim/ground", "sim/trial", "experiments/episodes",
               "experiments/results"),
}
# Rooms of a module from the ground up: a room includes those before it, never one after it. "." is the module's own
# folder. A folder `internal` belongs to the room above it, unless it is listed as a room itself.
ROOMS = {
    "core": ("system", "input", ".", "pictures", "process"),
    "renderer": ("scene", "raster", "cuda", ".", "files"),
    "reconstruction": ("upright", "datasets", "evaluation", "lifting", "segmentation", "stereo", "inspection", "rasterizer", "rasterizer/cuda",
                       "internal/tensors", "labels", "training"),
    "perception": ("data", "evaluation", "checkpoint", "internal/network", "internal/loss", "internal/yolov13",
                   "internal/centernet", "yolov13", "centernet",
                   "detector", "training", "models/text", "models", "models/internal/onnx"),
    "nav": ("grid", "mapping", "objects", "planning", "motion", "value", "behaviours", "frontier", "vlfm", "policies"),
    "sim": ("ground", "time", "sensors", "trial", "gazebo"),
    "ros": (".", "messages", "mcap", "dds"),
    "worlds": ("mesh", "mesh/gazebo", "mesh/furniture", "procedural", "capture", "surface", "masks"),
    "experiments": ("support", "specs", "drawing", "episodes", "records", "results", "suites", "reproducibility", "training", "scenes",
                    "detection", "benchmarks", "video", "ros2", "trials", "runs", "films", "bags", "panoptic", "scripted_trials", "report",
                    "web", "dashboard", "scene_labels", "commands/light", "commands", "commands/detectors",
                    "commands/scene", "commands/bridges", "."),
}
MOST_FILES = 25  # Of a folder; header and source of one class count once.
LIBRARY_HOME = {  # library: the only folders that may include it
    r"cuda|cub/|thrust/": {"renderer", "reconstruction", "perception"},
    r"OpenEXR/|Imath/|ImfNamespace|Imf": {"renderer/files", "worlds"},
    r"oneapi/tbb|tbb/|hwy/": {"renderer", "reconstruction", "sim", "worlds"},
    r"opencv2/": {"reconstruction", "perception", "nav", "sim", "worlds", "experiments"},
    r"pcl/": {"reconstruction", "nav", "worlds"},
    r"torch/|ATen/|c10/": {"perception", "reconstruction"},
    r"embree3/": {"sim/ground", "worlds"},
    r"assimp/|sdf/|ignition/": {"sim/gazebo", "worlds"},
    r"vtk": {"worlds"},
    r"recastnavigation/": {"sim/ground"},
    r"GeographicLib/": {"sim/ground", "worlds"},
    r"yaml-cpp/|openssl/": {"core"},
    r"nlohmann/": {"experiments", "perception", "peers", "reconstruction/datasets"},
    r"onnx/|google/protobuf|onnxruntime|oneapi/dnnl": {"perception"},
    r"zlib": {"experiments", "ros"},
    r"lz4|zstd": {"ros"},
    r"dds/|fastdds/|fastrtps/": {"ros/dds"},
    r"minizip/": {"worlds"},
    r"nanobind/": {"python"},
    r"sqlite3|CLI/|spdlog/|httplib": {"experiments", "perception"},
}
# Third-party types stay out of public headers, so that no includer pays for them.
NOT_IN_HEADERS = re.compile(r"torch/|ATen/|pcl/|opencv2/|embree3/|assimp/|sdf/|ignition/|recastnavigation/|"
                            r"GeographicLib/|dds/|fastdds/|fastrtps/|yaml-cpp/|sqlite3|CLI/|httplib|onnx/|google/protobuf|Imf|OpenEXR/|hwy/")
PAINTERS = ("experiments/drawing/", "experiments/video/")  # Their subject is OpenCV's images.
INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([^>"]+)[>"]')
SUFFIXES = {".h", ".cpp", ".cu", ".cuh"}


def sources(root, module):
    return (path for path in sorted((root / module).rglob("*")) if path.suffix in SUFFIXES)


def below(folder, parent):
    return parent == "." or folder == parent or folder.startswith(parent + "/")


def inside(parts):
    """The folder of a file, relative to its module."""
    return "/".join(parts[1:-1]) or "."


def room_of(module, folder):
    """The room that a folder, relative to its module, lies in: the longest that it lies below."""
    rooms = [room for room in ROOMS.get(module, ()) if room != "." and below(folder, room)]
    return max(rooms, key=len) if rooms else "."


def wrong_room(module, folder, target_folder):
    rooms = ROOMS.get(module)
    if rooms is None:
        return None
    room, target = room_of(module, folder), room_of(module, target_folder)
    for name in (room, target):
        if name not in rooms:
            return f"{module}/{folder} is no room of the table"
    if rooms.index(target) > rooms.index(room):
        return f"{module}/{room} must not include {module}/{target}: that room lies above"
    return None


def wrong_include(path, header):
    """What is wrong with one include of one file, both relative to the root; None if nothing is."""
    module, folder = path.parts[0], inside(path.parts)
    target = header.split("/")[0]
    if target in MAY_INCLUDE:
        target_folder = inside(header.split("/"))
        if target != module and not any(below(header, allowed) for allowed in MAY_INCLUDE[module]):
            return f"{module}/ must not include {header}"
        owner, internal, _ = header.partition("/internal/")
        if internal and not below(path.as_posix(), owner):
            return f"{header} is internal to {owner}/"
        return wrong_room(module, folder, target_folder) if target == module else None
    if path.suffix == ".h" and not path.stem.endswith("-inl") and "internal" not in path.parts and \
            NOT_IN_HEADERS.match(header) and not path.as_posix().startswith(PAINTERS):
        return f"{header} must not appear in a public header"
    for library, homes in LIBRARY_HOME.items():
        if re.match(library, header) and not any(below(path.as_posix(), home) for home in homes):
            return f"{module}/ must not use {header}"
    return None


def includes(path):
    for number, line in enumerate(path.read_text().splitlines(), start=1):
        match = INCLUDE.match(line)
        if match:
            yield number, match.group(1)


def files_by_folder(root):
    """Folder of code or tests -> names of its files without their suffix."""
    folders = collections.defaultdict(set)
    for module in (*MAY_INCLUDE, "tests", "examples", "tools"):
        for path in sources(root, module):
            folders[path.parent.relative_to(root).as_posix()].add(path.stem)
    return folders


def violations(root):
    for module in MAY_INCLUDE:
        for path in sources(root, module):
            relative = path.relative_to(root)
            for number, header in includes(path):
                wrong = wrong_include(relative, header)
                if wrong:
                    yield f"{relative}:{number}: {wrong}"
    for folder, names in files_by_folder(root).items():
        if len(names) > MOST_FILES:
            yield f"{folder}/: {len(names)} files, at most {MOST_FILES} find their way"


def print_graph(root):
    sizes = files_by_folder(root)
    for module in MAY_INCLUDE:
        edges = collections.defaultdict(set)
        count = collections.Counter()
        for path in sources(root, module):
            room = room_of(module, inside(path.relative_to(root).parts))
            edges[room]
            for _, header in includes(path):
                if header.split("/")[0] == module:
                    edges[room].add(room_of(module, inside(header.split("/"))))
        for folder, names in sizes.items():
            if folder.split("/")[0] == module:
                count[room_of(module, "/".join(folder.split("/")[1:]) or ".")] += len(names)
        print(module)
        for room in [r for r in ROOMS.get(module, sorted(edges)) if r in edges]:
            print(f"  {room:20} {count[room]:3} files   " + " ".join(sorted(edges[room] - {room})))


if __name__ == "__main__":
    arguments = sys.argv[1:]
    if "--help" in arguments or not 1 <= len(arguments) <= 2 or arguments[1:] not in ([], ["--graph"]):
        sys.exit(__doc__)
    root_folder = pathlib.Path(arguments[0])
    if arguments[1:]:
        print_graph(root_folder)
        sys.exit()
    found = list(violations(root_folder))
    print("\n".join(found) or "layers: ok")
    sys.exit(bool(found))
