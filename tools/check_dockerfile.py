#!/usr/bin/env python3
"""Fails when the Dockerfile has a list of packages of its own: check_dockerfile.py ROOT"""
import pathlib
import re
import sys

root = pathlib.Path(sys.argv[1])
text = re.sub(r"^#.*\n", "", (root / "Dockerfile").read_text(), flags=re.M).replace("\\\n", " ")
installs = re.findall(r"apt-get install ([^&\n]*)", text)
own = [word for install in installs for word in install.split() if not word.startswith(("-", "/tmp/"))]
wrong = []
if own:
    wrong.append(f"Dockerfile: expected packages of tools/debian_packages.txt alone, found {' '.join(own)}")
if not re.search(r"grep -v '\^#' tools/debian_packages\.txt \|\s+\S+ xargs apt-get install", text):
    wrong.append("Dockerfile: expected apt-get install of tools/debian_packages.txt, found none")
if not re.search(r"^FROM debian:12$", text, flags=re.M):
    wrong.append("Dockerfile: expected FROM debian:12, for whose packages the list is")
print("\n".join(wrong) or "dockerfile: ok")
sys.exit(bool(wrong))
