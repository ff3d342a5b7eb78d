"""Finds figures in the documentation that no record stands behind.

A figure is a number with a unit of a measurement, or a percentage. Those that the text sets rather than measures (limits,
settings, sizes, examples) are listed in results/specified_figures.txt, a line each: `docs/FILE.md: FIGURE`. Those that a
sentence quotes from a record name it, `docs/FILE.md: FIGURE (SUBJECT/NAME)`, and the record must have the number. Blocks
that are made from records, and code, are not looked at.
"""
import os
import re

UNIT = r"(?:ms|us|dB|FPS|frames/s|images/s|MB|GB|min|points|steps/s|GFLOP/s|GB/s|%)"
NUMBER = r"(?:\d{1,3}(?: \d{3})+|\d+)(?:\.\d+)?"
FIGURE = re.compile(rf"(?<![\w.-]){NUMBER}\s{UNIT}(?![\w/])|\bPQ \d+(?:\.\d+)?")
MADE_BLOCK = re.compile(r"<!-- records?: .*?<!-- end of records? -->", re.DOTALL)
FENCED = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
LIST = "results/specified_figures.txt"


def blank(match):
    return re.sub(r"[^\n]", " ", match[0])


def prose_of(text):
    """With everything else made blank, so that lines keep their numbers."""
    text = FENCED.sub(blank, MADE_BLOCK.sub(blank, text))
    return [("" if line.startswith("    ") else re.sub(r"`[^`]*`", " ", line)) for line in text.split("\n")]


def listed(root):
    """(page, figure, record or None)"""
    with open(os.path.join(root, LIST)) as file:
        for line in map(str.strip, file):
            if line and not line.startswith("#"):
                page, figure, record = re.fullmatch(r"(.+?): (.+?)(?: \((\w+/\w+)\))?", line).groups()
                yield page, figure, record


def quoted_wrongly(root, figure, record):
    path = os.path.join(root, "results", record + ".json")
    number = re.search(NUMBER, figure)[0].replace(" ", "")
    if not os.path.exists(path):
        return True
    with open(path) as file:
        return not re.search(rf"(?<![\d.]){re.escape(number)}(?![\d]|\.\d)", file.read())


def figures_without_record(root, pages):
    """Yields "docs/FILE.md:LINE: FIGURE: what is wrong"."""
    allowed = set()
    for page, figure, record in listed(root):
        allowed.add((page, figure))
        if record and quoted_wrongly(root, figure, record):
            yield f"{LIST}: {page}: {figure}: expected a record results/{record}.json that has this number"
    for page in pages:
        with open(os.path.join(root, page)) as file:
            for number, line in enumerate(prose_of(file.read()), 1):
                for figure in FIGURE.findall(line):
                    if (page, " ".join(figure.split())) not in allowed:
                        yield f"{page}:{number}: {figure}: a figure without a record (results/README.md tells what to do)"
