#!/usr/bin/env python3
"""Checks of the Markdown pages.

  check_markdown.py links ROOT   every link leads to a file and, with #..., to a heading in it; every path of this repository
                                 that is named in `backticks` is there and has no line number; every page of docs/ is in the site's menu
  check_markdown.py prose ROOT   no line of prose is longer than 120 characters
  check_markdown.py wrap FILE... wraps the paragraphs that have such a line

One line for every fault, with its place; exit code 1 if there is any. Links to the web are not followed. A line of prose is
one outside of code blocks, tables, headings, HTML comments and generated blocks. Of a link only its text counts, and a piece
of code that cannot be broken may be a long line of its own.
"""
import itertools
import pathlib
import re
import sys

LONGEST_LINE = 120
SKIPPED_FOLDERS = ("build", "out", ".git")
USERS_FOLDERS = ("models",)  # Of what a user has fetched; pages may mean another folder of that name.
# A history names files that are gone.
NAMES_OLD_FILES = ("CHANGELOG.md",)
LINK = re.compile(r"!?\[((?:[^\[\]]|\[[^\]]*\])*)\]\(\s*<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\s*\)")
TARGET = re.compile(r"\]\(\s*<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\s*\)")
DEFINITION = re.compile(r"^\[[^\]]+\]:\s*(\S+)")
CODE = re.compile(r"`([^`]+)`")
HEADING = re.compile(r"^(#{1,6})\s+(.*?)\s*#*\s*$")
FENCE = re.compile(r"^\s*(```+|~~~+)")
HTML_ANCHOR = re.compile(r"<a\s+(?:id|name)=\"([^\"]+)\"")
GENERATED_BEGIN = re.compile(r"^<!-- (records?|generated)\b")
GENERATED_END = re.compile(r"^<!-- end of (records?|generated)")
LINE_NUMBER = re.compile(r"/[\w.]+\.(?:cpp|cu|h|py|cmake|txt|md):\d+$")
PATH = re.compile(r"[\w.{},*-]+(?:/[\w.{},*-]+)+/?")


class Line:
    """A line of a page: where it stands and what it is part of."""

    def __init__(self, number, text, code, generated):
        self.number, self.text, self.code, self.generated = number, text, code, generated

    def is_table(self):
        return self.text.lstrip().startswith("|")

    def is_prose(self):
        text = self.text.strip()
        return not (self.code or self.generated or self.is_table() or text.startswith(("#", "<!--")))


def pages(root):
    for path in sorted(root.rglob("*.md")):
        parts = path.relative_to(root).parts
        if not any(part.startswith(SKIPPED_FOLDERS) for part in parts[:-1]):
            yield path


def lines_of(path):
    fence, generated, after_blank, indented = None, False, True, False
    for number, text in enumerate(path.read_text().splitlines(), start=1):
        mark = FENCE.match(text)
        if fence is None and mark:
            fence = mark.group(1)
            yield Line(number, text, True, generated)
            continue
        if fence is not None:
            if mark and mark.group(1).startswith(fence):
                fence = None
            yield Line(number, text, True, generated)
            continue
        if GENERATED_BEGIN.match(text):
            generated = True
        if text.strip():
            # Four spaces after an empty line begin a code block; what follows at four spaces belongs to it.
            indented = text.startswith("    ") and (after_blank or indented)
        yield Line(number, text, indented and bool(text.strip()), generated)
        if GENERATED_END.match(text):
            generated = False
        after_blank = not text.strip()


def slug(heading):
    """The anchor that GitHub and mkdocs give to a heading."""
    text = LINK.sub(lambda link: link.group(1), heading).replace("`", "")
    text = re.sub(r"[^\w\s-]", "", text.lower()).strip()
    return re.sub(r"\s+", "-", text)


def anchors(path):
    found = set()
    for line in lines_of(path):
        if line.code:
            continue
        found.update(HTML_ANCHOR.findall(line.text))
        heading = HEADING.match(line.text)
        if not heading:
            continue
        name = slug(heading.group(2))
        # A heading that occurs again is numbered: -1 by GitHub, _1 by mkdocs.
        found.add(name if name not in found else next(
            f"{name}-{n}" for n in itertools.count(1) if f"{name}-{n}" not in found))
    return found


def targets(line):
    if line.code:
        return
    text = CODE.sub(lambda code: "x" * len(code.group(0)), line.text)
    yield from TARGET.findall(text)  # The link's text may have begun on the line before.
    definition = DEFINITION.match(text)
    if definition:
        yield definition.group(1)


def broken_link(root, page, target):
    """What is wrong with the target of a link; None if nothing is."""
    if re.match(r"[a-z][a-z0-9+.-]*:", target):
        return None
    file, _, anchor = target.partition("#")
    aim = (page.parent / file).resolve() if file else page
    if not aim.exists():
        return f"there is no {file}"
    if root not in aim.parents and aim != root:
        return f"{file} lies outside of this repository"
    # The site is made of docs/ alone.
    if root / "docs" in page.parents and root / "docs" not in aim.parents:
        return f"{file} lies outside of docs/, where the site cannot show it; name it in `backticks`"
    if anchor and aim.suffix == ".md" and anchor not in anchors(aim):
        return f"{aim.relative_to(root)} has no heading for #{anchor}"
    return None


def alternatives(pattern):
    """a/{b,c}.h -> a/b.h, a/c.h"""
    braces = re.search(r"\{([^{}]*)\}", pattern)
    if not braces:
        return [pattern]
    return [name for part in braces.group(1).split(",")
            for name in alternatives(pattern[:braces.start()] + part + pattern[braces.end():])]


def missing_file(root, code):
    """The first path in a piece of code that should be a file of this repository and is not."""
    for word in code.split():
        word = word.rstrip(".,;:")
        if not PATH.fullmatch(word):
            continue
        for name in alternatives(word):
            top = name.split("/")[0]
            if not (root / top).is_dir() or top.startswith(SKIPPED_FOLDERS) or top in USERS_FOLDERS or "*" in top:
                continue
            if "." not in name.rstrip("/").split("/")[-1] and not name.endswith("/"):
                continue  # A word such as `renderer/exr_io`, the name of a test.
            if not any(root.glob(name.rstrip("/"))):
                return name
    return None


def link_faults(root, page):
    if left_out_of_menu(root, page):
        yield 1, "the menu in mkdocs.yml does not lead here"
    for line in lines_of(page):
        for target in targets(line):
            wrong = broken_link(root, page, target)
            if wrong:
                yield line.number, wrong
        if page.name in NAMES_OLD_FILES or line.code:
            continue
        for code in CODE.findall(line.text):
            if LINE_NUMBER.search(code):
                yield line.number, f"{code}: lines move; name what stands there"
            missing = missing_file(root, code)
            if missing:
                yield line.number, f"there is no {missing}"


def shown_length(text):
    return len(LINK.sub(lambda link: link.group(1), text))


def left_out_of_menu(root, page):
    """Whether the site's menu (mkdocs.yml) leads to this page of docs/."""
    if root / "docs" not in page.parents:
        return False
    menu = (root / "mkdocs.yml").read_text()
    return not re.search(rf":\s+{re.escape(page.relative_to(root / 'docs').as_posix())}$", menu, re.MULTILINE)


def prose_faults(root, page):
    for line in lines_of(page):
        length = shown_length(line.text)
        one_piece = PIECE.fullmatch(line.text.strip())
        if line.is_prose() and length > LONGEST_LINE and not one_piece:
            yield line.number, f"{length} characters of prose, at most {LONGEST_LINE}"


# At the beginning of a line these would make it a list item, a heading or a quotation.
MARKER = re.compile(r"[-*+#]+|\d+[.)]|[=>|].*")
ITEM = re.compile(r"^(\s*)([-*+]|\d+[.)])(\s+)")
# A piece that must stay on one line: code, a link's target with the last word of its text, any other word.
PIECE = re.compile(r"(?:`[^`]*`|\]\([^)]*\)|[^\s`])+")


def wrapped(texts):
    """The lines of a paragraph or a list item, wrapped anew."""
    item = ITEM.match(texts[0])
    first = item.group(0) if item else re.match(r"\s*", texts[0]).group(0)
    rest = " " * len(first)
    pieces = []
    for piece in PIECE.findall(" ".join([texts[0][len(first):]] + [text.strip() for text in texts[1:]])):
        if pieces and MARKER.fullmatch(piece):
            pieces[-1] += " " + piece
        else:
            pieces.append(piece)
    lines, line = [], first + pieces[0]
    for piece in pieces[1:]:
        if shown_length(f"{line} {piece}") <= LONGEST_LINE:
            line += " " + piece
        else:
            lines.append(line)
            line = rest + piece
    return lines + [line]


def wrap(path):
    out, paragraph = [], []

    def flush():
        nonlocal paragraph
        if any(shown_length(text) > LONGEST_LINE for text in paragraph):
            paragraph = wrapped(paragraph)
        out.extend(paragraph)
        paragraph = []

    for line in lines_of(path):
        if not line.is_prose() or not line.text.strip():
            flush()
            out.append(line.text)
            continue
        if ITEM.match(line.text) or line.text.lstrip().startswith((">", "![", "<")):
            flush()
        paragraph.append(line.text)
    flush()
    path.write_text("\n".join(out) + "\n")


CHECKS = {"links": link_faults, "prose": prose_faults}


def main(check, root):
    root = pathlib.Path(root).resolve()
    faults = 0
    for page in pages(root):
        for number, what in CHECKS[check](root, page):
            print(f"{page.relative_to(root)}:{number}: {what}")
            faults += 1
    return 1 if faults else 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["wrap"] and len(sys.argv) > 2:
        for name in sys.argv[2:]:
            wrap(pathlib.Path(name))
        sys.exit(0)
    if len(sys.argv) != 3 or sys.argv[1] not in CHECKS:
        sys.exit(__doc__)
    sys.exit(main(sys.argv[1], sys.argv[2]))
