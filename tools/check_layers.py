#!/usr/bin/env python3
"""Fails when a file includes a folder or a library that its own folder may not use.

The two tables below are the architecture; docs/architecture.md draws them.
"""
import pathlib
import re
import sys

MAY_INCLUDE = {  # folder: the folders its files may include, besides its own
    "core": set(),
    "renderer": {"core"},
    "perception": {"core"},
    "nav": {"core"},
    "sim": {"core"},
    "experiments": {"core", "renderer", "perception", "nav", "sim"},
}
LIBRARY_HOME = {  # library: the only folders that may include it
    r"cuda|cub/|thrust/": {"renderer", "perception"},
    r"OpenEXR/|Imath/|ImfNamespace|Imf|oneapi/tbb|tbb/|hwy/": {"renderer", "sim"},
    r"opencv2/": {"renderer", "perception", "nav", "sim", "experiments"},
    r"pcl/": {"renderer", "nav", "sim"},
    r"torch/|ATen/|c10/": {"perception", "renderer/training"},
    r"embree3/|assimp/|sdf/|ignition/|recastnavigation/": {"sim"},
    r"GeographicLib/": {"sim"},
    r"yaml-cpp/|openssl/": {"core"},
    r"nlohmann/": {"experiments", "perception", "renderer/datasets"},
    r"onnx/|google/protobuf|onnxruntime|oneapi/dnnl": {"perception"},
    r"zlib": {"experiments"},
    r"sqlite3|CLI/|spdlog/|httplib": {"experiments", "perception"},
}
# Third-party types stay out of public headers, so that no includer pays for them.
NOT_IN_HEADERS = re.compile(r"torch/|ATen/|pcl/|opencv2/|embree3/|assimp/|sdf/|ignition/|recastnavigation/|"
                            r"GeographicLib/|yaml-cpp/|sqlite3|CLI/|httplib|onnx/|google/protobuf|Imf|OpenEXR/|hwy/")
INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([^>"]+)[>"]')
SUFFIXES = {".h", ".cpp", ".cu", ".cuh"}


def violations(root):
    for folder, allowed in MAY_INCLUDE.items():
        for path in sorted((root / folder).rglob("*")):
            if path.suffix not in SUFFIXES:
                continue
            for number, line in enumerate(path.read_text().splitlines(), start=1):
                match = INCLUDE.match(line)
                if not match:
                    continue
                where = f"{path.relative_to(root)}:{number}"
                header = match.group(1)
                target = header.split("/")[0]
                if target in MAY_INCLUDE and target != folder and target not in allowed:
                    yield f"{where}: {folder}/ must not include {target}/ ({header})"
                if "/internal/" in header and target != folder:
                    yield f"{where}: {header} is internal to {target}/"
                if path.suffix == ".h" and "internal" not in path.parts and \
                        NOT_IN_HEADERS.match(header):
                    yield f"{where}: {header} must not appear in a public header"
                for library, homes in LIBRARY_HOME.items():
                    if re.match(library, header) and not any(
                            path.relative_to(root).as_posix().startswith(home + "/")
                            for home in homes):
                        yield f"{where}: {folder}/ must not use {header}"


if __name__ == "__main__":
    found = list(violations(pathlib.Path(sys.argv[1])))
    print("\n".join(found) or "layers: ok")
    sys.exit(bool(found))
