#!/usr/bin/env python3
"""The quickstart's record: made from a run, and printed as the table of the README.

  quickstart_record.py make WORK RECORD.json       from the work folder of `segsim run`
  quickstart_record.py readme RECORD.json README   puts the table between its two markers
  quickstart_record.py check RECORD.json README    exit code 1 if the README says something else
"""
import json
import os
import statistics
import sys

BEGIN, END = "<!-- results/quickstart.json -->", "<!-- end of results/quickstart.json -->"
STRICT = "habitat-hm3d"


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


def make(work, record):
    with open(os.path.join(work, "table.json")) as file:
        table = json.load(file)
    with open(os.path.join(work, "digests.json")) as file:
        digests = json.load(file)
    provenance = table["provenance"]
    trainings = []
    for training in table["trainings"]:
        arm = provenance["arms"][training["arm"]]
        before = table["all"]["arms"][table["before"]]["successes"]
        trainings.append({"seed": training["seed"], "after": training["successes"], "before": before,
                          "trials": training["episodes"], "ap50": arm["held_out"]["ap50"],
                          "ap50_before": provenance["arms"][training["before"]]["held_out"]["ap50"],
                          "score_threshold": arm["held_out"]["score_threshold"],
                          "views_near_starts": arm["tuning_views"]["near_starts"]})
    out = {"schema": "segsim.quickstart_record/1",
           "command": f"tools/record_quickstart.sh {len(trainings)}",
           "commit": provenance["code_version"],
           "date": provenance["ended"][:10],
           "machine": provenance["host"].split(", ", 1)[-1],
           "kernels": digests["machine"]["kernels"],
           "trials_sha256": digests["stages"][-1]["sha256"],
           "success": provenance["success_profile"],
           "strict_rule": STRICT,
           "trainings": trainings,
           "training_rate_sd": table["training_rate_sd"],
           "rows": [row(table, group) for group in table["scenes"] + [table["all"]]]}
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


def table_of(record):
    trainings = record["trainings"]
    gains = [t["after"] - t["before"] for t in trainings]
    better = sum(gain > 0 for gain in gains)
    trials = trainings[0]["trials"]
    lines = ["| scene | before | after | difference [points] | p | oracle | strict rule: before, after, oracle |",
             "|---|---|---|---|---|---|---|"]
    for r in record["rows"]:
        low, high = r["difference95"]
        lines.append(
            f"| {r['title']} | {cell(r['before'])} | {cell(r['after'], True)} | {100 * r['difference']:+.0f} "
            f"[{100 * low:+.0f}, {100 * high:+.0f}] | {r['p']:.2g} | {percent(r['oracle']['sr'])} % | "
            + ", ".join(f"{percent(r[a]['strict_sr'])} %" for a in ("before", "after", "oracle")) + " |")
    near = sum(t["views_near_starts"] for t in trainings)
    after = sorted(t["after"] for t in trainings)
    ap50 = sorted(100 * t["ap50"] for t in trainings)
    lines += ["", f"{len(trainings)} fine-tunings with other seeds, {trials} episodes each; the intervals count how trainings "
              f"differ (`docs/metrics.md`). After fine-tuning {', '.join(map(str, after))} of {trials} episodes succeed, before "
              f"{trainings[0]['before']}: {better} of {len(trainings)} trainings are better, the median gain is "
              f"{100 * statistics.median(gains) / trials:+.0f} points. AP50 on held-out views goes from "
              f"{100 * trainings[0]['ap50_before']:.0f} to {ap50[0]:.0f} ... {ap50[-1]:.0f} (median "
              f"{statistics.median(ap50):.0f}). {near} training views lie near a start of an episode. Success: "
              f"{record['success']}; the strict rule is {record['strict_rule']} (STOP within 0.1 m of a view point).",
              "", f"`{record['command']}`, commit {record['commit']}, {record['machine']}, {record['kernels']} kernels, "
              f"{record['date']}; trials {record['trials_sha256'][:12]}."]
    return "\n".join(lines)


def with_table(text, record, place):
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        sys.exit(f"quickstart_record.py: {place}: expected one {BEGIN} and one {END}")
    head, rest = text.split(BEGIN)
    return f"{head}{BEGIN}\n{table_of(record)}\n{END}{rest.split(END)[1]}"


def main(arguments):
    if len(arguments) != 3 or arguments[0] not in ("make", "readme", "check"):
        sys.exit(__doc__)
    if arguments[0] == "make":
        make(arguments[1], arguments[2])
        return
    with open(arguments[1]) as file:
        record = json.load(file)
    with open(arguments[2]) as file:
        text = file.read()
    wanted = with_table(text, record, arguments[2])
    if arguments[0] == "check":
        if wanted != text:
            sys.exit(f"{arguments[2]}: its table is not that of {arguments[1]}; run quickstart_record.py readme")
        return
    with open(arguments[2], "w") as file:
        file.write(wanted)


if __name__ == "__main__":
    main(sys.argv[1:])
