"""Records of measurements, and every page that is made from them.

  python3 tools/results write ROOT                  makes docs/results.md, docs/results/, docs/goals.md, and the tables in other pages
  python3 tools/results check ROOT                  exit code 1 if a page says something else than its records, a page of docs/
                                                    has a figure without a record, or a record has a commit that is
                                                    none, or no sentence about what was not recorded
  python3 tools/results run WORK RECORD COMMAND     the record of a finished `segsim run`, and the command that makes it
  python3 tools/results take NEW... RECORD          puts newly measured records, joined, in place of RECORD, whose title, note
                                                    and goals stay; prints which figures have changed

A page takes in a record's tables between <!-- record: SUBJECT/NAME --> and <!-- end of record -->; the first page has the
tables of several runs between <!-- records: NAME... --> and <!-- end of records -->. results/README.md tells the format.
"""
import os
import re
import subprocess
import sys

import headline
import pages
from figures import figures_without_record
from record import BadRecord, lacking, read_record, read_index, write_atomically, write_record
from run_record import joined, keep_words, run_record

HEADLINE = re.compile(r"(<!-- records: ([a-z0-9_ ]+) -->\n).*?(<!-- end of records -->)", re.DOTALL)
BLOCK = re.compile(r"(<!-- record: ([a-z0-9_]+)/([a-z0-9_]+) -->\n).*?(<!-- end of record -->)", re.DOTALL)
RUNS = "object_search"  # The subject of the first page's records.


def record_of(subjects, page, subject, name):
    for s in subjects:
        if s.name == subject and name in s.records:
            return s.records[name]
    raise BadRecord(f"{page}: expected a record of results/, found {subject}/{name}")


def with_blocks(root, subjects, page, text):
    to_docs = "" if page.startswith("docs/") else "docs/"

    def runs(match):
        records = [record_of(subjects, page, RUNS, name) for name in match[2].split()]
        return match[1] + headline.headline_text(root, records) + "\n" + match[3]

    def one(match):
        record = record_of(subjects, page, match[2], match[3])
        return f"{match[1]}\n{pages.marked_record(record, match[2], to_docs)}\n\n{match[4]}"

    return BLOCK.sub(one, HEADLINE.sub(runs, text))


def whole_pages(subjects, limits):
    """path -> text, of the pages that are nothing but records."""
    made = {f"docs/results/{subject.name}.md": pages.subject_page(subject) for subject in subjects}
    return {**made, "docs/results.md": pages.results_index(subjects, limits), "docs/goals.md": pages.goals_page(subjects)}


def prose_pages(root, made):
    """README.md and what lies in docs/ itself."""
    names = ["README.md"] + sorted("docs/" + name for name in os.listdir(os.path.join(root, "docs")) if name.endswith(".md"))
    return [name for name in names if name not in made]


def wanted_pages(root):
    subjects, limits = read_index(root)
    wanted = whole_pages(subjects, limits)
    for page in prose_pages(root, wanted):
        with open(os.path.join(root, page)) as file:
            text = file.read()
        if "<!-- record" in text:
            wanted[page] = with_blocks(root, subjects, page, text)
    return wanted


def text_of(path):
    if not os.path.exists(path):
        return None
    with open(path) as file:
        return file.read()


def write(root):
    wanted = wanted_pages(root)
    for page, text in wanted.items():
        if text_of(os.path.join(root, page)) != text:
            write_atomically(os.path.join(root, page), text)
            print(page)
    for page in left_over(root, wanted):
        os.remove(os.path.join(root, page))
        print(f"{page} removed")


def left_over(root, wanted):
    """Pages of subjects that are no more."""
    folder = os.path.join(root, "docs", "results")
    there = sorted(os.listdir(folder)) if os.path.isdir(folder) else []
    return [f"docs/results/{name}" for name in there if f"docs/results/{name}" not in wanted]


def git(root, *arguments):
    return subprocess.run(["git", "-C", root, *arguments], capture_output=True, text=True)


def strange_commits(root):
    """Records of what nobody can check out. Without the whole history, only uncommitted changes are seen."""
    shallow = git(root, "rev-parse", "--is-shallow-repository")
    history = shallow.returncode == 0 and shallow.stdout.strip() == "false"
    for subject in read_index(root)[0]:
        for name, record in subject.records.items():
            commit = record["commit"]
            if commit and (commit.endswith("-dirty")
                           or history and git(root, "cat-file", "-e", commit + "^{commit}").returncode != 0):
                yield (f"results/{subject.name}/{name}.json: commit: expected one of this history, "
                       f"with nothing changed after it, found {commit}")


def unexplained(root):
    """Records that do not say why their command, commit, date or machine is missing."""
    for subject in read_index(root)[0]:
        for name, record in subject.records.items():
            reasons = record.get("not_recorded", {})
            if set(reasons) != set(lacking(record)):
                yield (f"results/{subject.name}/{name}.json: not_recorded: expected a sentence for each of "
                       f"{lacking(record)}, found {list(reasons)}")


def check(root):
    wanted = wanted_pages(root)
    faults = [f"{page}: not what its records say; run python3 tools/results write {root}"
              for page, text in wanted.items() if text_of(os.path.join(root, page)) != text]
    faults += [f"{page}: no subject of results/ has this page" for page in left_over(root, wanted)]
    faults += figures_without_record(root, prose_pages(root, whole_pages([], [])))
    faults += strange_commits(root)
    faults += unexplained(root)
    if faults:
        sys.exit("\n".join(faults))


def take(new_paths, path):
    new = joined([read_record(new_path) for new_path in new_paths], new_paths)
    if os.path.exists(path):
        old = read_record(path)
        new = keep_words(new, old)
        before = {(v.get("table"), v.get("case"), v["name"]): v for v in old["values"]}
        for v in new["values"]:
            key = (v.get("table"), v.get("case"), v["name"])
            if before.pop(key, {}).get("value") != v["value"]:
                print(f"{': '.join(part for part in key if part)}: {v['value']} {v['unit']}")
        for key, v in before.items():
            print(f"{': '.join(part for part in key if part)}: gone{', and its goal with it' if 'goal' in v else ''}")
    write_record(path, new)


def main(arguments):
    command, rest = (arguments[0], arguments[1:]) if arguments else ("", [])
    if command == "write" and len(rest) == 1:
        write(*rest)
    elif command == "check" and len(rest) == 1:
        check(*rest)
    elif command == "run" and len(rest) == 3:
        record = run_record(rest[0], rest[2])
        write_record(rest[1], keep_words(record, read_record(rest[1])) if os.path.exists(rest[1]) else record)
    elif command == "take" and len(rest) >= 2:
        take(rest[:-1], rest[-1])
    else:
        print(__doc__, file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except BadRecord as error:
        print(error, file=sys.stderr)
        sys.exit(2)
