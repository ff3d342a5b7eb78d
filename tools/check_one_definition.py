#!/usr/bin/env python3
"""Fails when two files define different classes of one name: the linker keeps either one's
functions, silently ([basic.def.odr]).

Looks at the program's folders, at classes and enumerations that stand at the top of a named
namespace. Compilers see one file at a time, and so does this: no preprocessor.
"""
import collections
import pathlib
import re
import sys

FOLDERS = ["core", "renderer", "perception", "nav", "sim", "ros", "peers", "experiments"]
NAMESPACE = re.compile(r"(?:inline )?namespace\s*([\w:]*)\s*\{")
NAMESPACE_END = re.compile(r"\}  // namespace")
DEFINITION = re.compile(r"(?:template\s*<[^{;]*>\s*)?(?:struct|class|enum class)\s+(?:alignas\([^)]*\)\s*)?"
                        r"(\w+)(?:\s+final)?(?:\s*:[^:;{][^;{]*)?\s*\{")


def definitions(path):
    open_namespaces = []
    for line in path.read_text().splitlines():
        begin = NAMESPACE.match(line)
        if begin:
            open_namespaces.append(begin.group(1) or "<unnamed>")
        elif NAMESPACE_END.match(line):
            open_namespaces.pop()
        definition = DEFINITION.match(line)
        if definition and "<unnamed>" not in open_namespaces:
            yield "::".join([*open_namespaces, definition.group(1)])


def main(root):
    files_of = collections.defaultdict(set)
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in {".h", ".cpp", ".cu", ".cuh"}:
                for name in definitions(path):
                    files_of[name].add(path.relative_to(root).as_posix())
    twice = {name: files for name, files in files_of.items() if len(files) > 1}
    for name, files in sorted(twice.items()):
        print(f"{name} is defined in {' and in '.join(sorted(files))}")
    if not files_of:
        print(f"{root}: expected the project's folders, found no definition")
    return 1 if twice or not files_of else 0


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1])))
