#!/usr/bin/env python3
"""Records of results, and the README's tables, which are made from them.

  readme_tables.py record WORK RECORD.json COMMAND   the record of a finished `segsim run`, and the command that makes it
  readme_tables.py write ROOT                        puts the tables into ROOT/README.md
  readme_tables.py check ROOT                        exit code 1 if the README says something else

A table stands between <!-- records: NAME... --> and <!-- end of records -->; NAME is that of results/NAME.json. Digests
are those of experiments/specs/digests/, which `segsim doctor --record` has written.
"""
import json
import os
import re
import statistics
import sys

BLOCK = re.compile(r"(<!-- records: ([a-z ]+) -->\n).*?(<!-- end of records -->)", re.DOTALL)
STRICT = "habitat-hm3d"


def read_json(*path):
    with open(os.path.join(*path)) as file:
        return json.load(file)


def rate(group, arm):
    a = group["arms"][arm]
    low, high = a.get("hierarchical95") or a["wilson95"]
    return {"successes": a["successes"], "trials": a["episodes"], "sr": a["sr"], "interval95": [low, high],
            "strict_sr": a["profiles"][STRICT]["sr"]}


def row(table, group):
    comparison = group["comparison"]
    result = {"title": group["title"], "p": comparison.get("p_trainings", comparison.get("p_mcnemar_exact")),
              "difference": comparison["difference"],
              "difference95": comparison.get("hierarchical95") or comparison["newcombe95"]}
    for role in ("before", "after", "oracle"):
        result[role] = rate(group, table[role])
    return result


def training_row(table, training):
    arms = table["provenance"]["arms"]
    arm = arms[training["arm"]]
    before = sum(group["arms"][table["before"]]["successes"] for group in table["scenes"])
    return {"seed": training["seed"], "after": training["successes"], "before": before, "trials": training["episodes"],
            "ap50": arm["held_out"]["ap50"], "ap50_before": arms[training["before"]]["held_out"]["ap50"],
            "score_threshold": arm["held_out"]["score_threshold"],
            "views_near_starts": arm["tuning_views"]["near_starts"]}


def make_record(work, record, command):
    table, digests = read_json(work, "table.json"), read_json(work, "digests.json")
    provenance = table["provenance"]
    trainings = [training_row(table, training) for training in table["trainings"]]
    out = {"schema": "segsim.result_record/1",
           "experiment": digests["experiment"],
           "command": command,
           "commit": provenance["code_version"],
           "date": provenance["ended"][:10],
           "machine": provenance["host"].split(", ", 1)[-1],
           "kernels": digests["machine"]["kernels"],
           "trials_sha256": digests["stages"][-1]["sha256"],
           "success": provenance["success_profile"],
           "strict_rule": STRICT,
           "trainings": trainings,
           "training_rate_sd": table["training_rate_sd"],
           "rows": [row(table, group) for group in table["scenes"] + ([table["all"]] if table.get("all") else [])]}
    os.makedirs(os.path.dirname(record) or ".", exist_ok=True)
    with open(record + ".part", "w") as file:
        json.dump(out, file, indent=1)
        file.write("\n")
    os.replace(record + ".part", record)


def percent(value):
    return f"{100 * value:.0f}"


def cell(r, bold=False):
    text = f"{percent(r['sr'])} % [{percent(r['interval95'][0])}, {percent(r['interval95'][1])}]"
    return f"**{text}**" if bold else text


def table_lines(records):
    yield "| scene | before | after | difference [points] | p | oracle | strict rule: before, after, oracle |"
    yield "|---|---|---|---|---|---|---|"
    for r in (r for record in records for r in record["rows"]):
        low, high = r["difference95"]
        yield (f"| {r['title']} | {cell(r['before'])} | {cell(r['after'], True)} | {100 * r['difference']:+.0f} "
               f"[{100 * low:+.0f}, {100 * high:+.0f}] | {r['p']:.2g} | {percent(r['oracle']['sr'])} % | "
               + ", ".join(f"{percent(r[a]['strict_sr'])} %" for a in ("before", "after", "oracle")) + " |")


def digests_in_words(digests):
    """Of the last stages: what departs earlier departs there, too."""
    weights = [s["sha256"][:12] for s in digests["stages"] if s["stage"] == "weights" and s["subject"] != "arm-before"]
    trials = digests["stages"][-1]["sha256"][:12]
    return (f"`{digests['experiment']}.yaml` as shipped ends in these digests: fine-tuned weights {', '.join(weights)}; "
            f"trials {trials} (found on: {', '.join(digests['confirmed_on'])}).")


def in_words(record, digests):
    trainings = record["trainings"]
    gains = [t["after"] - t["before"] for t in trainings]
    better = sum(gain > 0 for gain in gains)
    trials = trainings[0]["trials"]
    near = sum(t["views_near_starts"] for t in trainings)
    after = sorted(t["after"] for t in trainings)
    ap50 = sorted(100 * t["ap50"] for t in trainings)
    yield (f"{' and '.join(r['title'] for r in record['rows'] if r['title'] != 'All scenes')}: {len(trainings)} fine-tunings "
           f"with other seeds, {trials} episodes each; the intervals count how trainings differ (`docs/metrics.md`). After "
           f"fine-tuning {', '.join(map(str, after))} of {trials} episodes succeed, before {trainings[0]['before']}: {better} "
           f"of {len(trainings)} trainings are better, the median gain is "
           f"{100 * statistics.median(gains) / trials:+.0f} points. AP50 on held-out views goes from "
           f"{100 * trainings[0]['ap50_before']:.0f} to {ap50[0]:.0f} ... {ap50[-1]:.0f} (median "
           f"{statistics.median(ap50):.0f}). {near} training views lie near a start of an episode. Success: "
           f"{record['success']}; the strict rule is {record['strict_rule']} (STOP within 0.1 m of a view point).")
    yield (f"`{record['command']}`, commit {record['commit']}, {record['machine']}, {record['kernels']} kernels, "
           f"{record['date']}. {digests_in_words(digests)}")


def block_text(root, names):
    records = [read_json(root, "results", name + ".json") for name in names]
    lines = list(table_lines(records))
    for record in records:
        digests = read_json(root, "experiments/specs/digests", record["experiment"] + ".json")
        for paragraph in in_words(record, digests):
            lines += ["", paragraph]
    return "\n".join(lines) + "\n"


def main(arguments):
    if len(arguments) == 4 and arguments[0] == "record":
        make_record(*arguments[1:])
        return
    if len(arguments) != 2 or arguments[0] not in ("write", "check"):
        sys.exit(__doc__)
    root = arguments[1]
    readme = os.path.join(root, "README.md")
    with open(readme) as file:
        text = file.read()
    wanted, tables = BLOCK.subn(lambda m: m[1] + block_text(root, m[2].split()) + m[3], text)
    if tables == 0:
        sys.exit(f"{readme}: expected <!-- records: NAME... --> ... <!-- end of records -->, found none")
    if arguments[0] == "check":
        if wanted != text:
            sys.exit(f"{readme}: a table is not that of its records; run tools/readme_tables.py write {root}")
        return
    with open(readme, "w") as file:
        file.write(wanted)


if __name__ == "__main__":
    main(sys.argv[1:])
