#!/usr/bin/env python3
"""Tests of tools/check_markdown.py on small repositories with one fault each."""
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools"))
import check_markdown  # noqa: E402


class Repository(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = pathlib.Path(folder.name).resolve()
        self.write("core/camera.h", "")
        self.write("mkdocs.yml", "nav:\n  - Start: index.md\n")
        self.write("docs/index.md", "# Start\n\n## Words & symbols\n\n## Again\n\n## Again\n")

    def write(self, name, text):
        file = self.root / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        return file

    def faults(self, check, name, text):
        return [what for _, what in check_markdown.CHECKS[check](self.root, self.write(name, text))]

    def assert_fault(self, check, name, text, what):
        found = self.faults(check, name, text)
        self.assertEqual(len(found), 1, f"{text!r} gives {found}")
        self.assertIn(what, found[0])


class Links(Repository):
    def test_good_ones_pass(self):
        text = ("[a](docs/index.md), ![b](docs/index.md#words-symbols), [web](https://example.org/#x), [again](docs/index.md#again-1)\n"
                "`core/camera.h`, `core/{camera,camera}.h`, `core/*.h`, `renderer/exr_io`, `docs/`\n"
                "```\n[c](nowhere.md) `core/gone.h`\n```\n")
        self.assertEqual(self.faults("links", "README.md", text), [])

    def test_missing_file(self):
        self.assert_fault("links", "README.md", "see [this](docs/gone.md)", "no docs/gone.md")

    def test_missing_image_inside_a_link(self):
        self.assert_fault("links", "README.md", "[![x](gone.png)](docs/index.md)", "no gone.png")

    def test_missing_heading(self):
        self.assert_fault("links", "README.md", "see [this](docs/index.md#gone)", "no heading for #gone")
        self.assert_fault("links", "README.md", "# Here\n[this](#there)", "no heading for #there")

    def test_missing_target_of_a_reference(self):
        self.assert_fault("links", "README.md", "[name]: docs/gone.md", "no docs/gone.md")

    def test_missing_path_in_backticks(self):
        self.assert_fault("links", "README.md", "as in `core/gone.h`", "no core/gone.h")
        self.assert_fault("links", "README.md", "as in `core/{camera,gone}.h`", "no core/gone.h")

    def test_folders_of_users(self):
        (self.root / "models").mkdir()
        self.assertEqual(self.faults("links", "README.md", "`models/sofa.dae` of a world"), [])

    def test_line_numbers(self):
        self.assert_fault("links", "README.md", "as in `core/camera.h:12`", "lines move")

    def test_a_page_of_the_site_leads_nowhere_else(self):
        self.write("README.md", "")
        self.assert_fault("links", "docs/index.md", "see [this](../README.md)", "outside of docs/")

    def test_a_page_that_no_menu_leads_to(self):
        self.assert_fault("links", "docs/lost.md", "# Lost", "menu")


class Prose(Repository):
    LONG = "word " * 30

    def test_long_lines_of_prose(self):
        self.assert_fault("prose", "README.md", self.LONG, "characters")
        self.assert_fault("prose", "README.md", "- " + self.LONG, "characters")
        self.assert_fault("prose", "README.md", "- item\n    " + self.LONG, "characters")

    def test_what_is_no_prose(self):
        for text in (f"# {self.LONG}", f"| {self.LONG} |", f"```\n{self.LONG}\n```", f"\n    {self.LONG}",
                     f"<!-- records: x -->\n{self.LONG}\n<!-- end of records -->", f"[text]({'x' * 200})"):
            self.assertEqual(self.faults("prose", "README.md", text), [], text)

    def test_wrapping_keeps_every_word(self):
        text = f"# Title\n\n- {self.LONG}`code that stays on one line` {self.LONG} - not an item\n  {self.LONG}\n\n    {self.LONG}\n"
        file = self.write("README.md", text)
        check_markdown.wrap(file)
        self.assertEqual(self.faults("prose", "README.md", file.read_text()), [])
        self.assertEqual(file.read_text().split(), text.split())
        self.assertIn("`code that stays on one line`", file.read_text())
        self.assertEqual(sum(line.lstrip().startswith("- ") for line in file.read_text().splitlines()), 1)


if __name__ == "__main__":
    unittest.main()
