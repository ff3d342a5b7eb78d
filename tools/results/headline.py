"""The tables of the first page: success before and after fine-tuning, from the records of runs."""
import os
import statistics

from pages import wrapped
from record import read_json
from run_record import ROLES, STRICT, SUCCESS, TRAININGS


def rows_of(record, table):
    """case -> name -> value, in order."""
    rows = {}
    for value in record["values"]:
        if value.get("table") == table:
            rows.setdefault(value["case"], {})[value["name"]] = value
    return rows


def whole(number):
    return f"{number:.0f}"


def rate_text(value, bold):
    text = f"{whole(value['value'])} % [{', '.join(whole(end) for end in value['interval95'])}]"
    return f"**{text}**" if bold else text


def table_lines(records):
    yield "| scene | before | after | difference [points] | p | oracle | strict rule: before, after, oracle |"
    yield "|---|---|---|---|---|---|---|"
    for record in records:
        for title, row in rows_of(record, SUCCESS).items():
            low, high = row["difference"]["interval95"]
            strict = ", ".join(f"{whole(row[f'{role}, {STRICT}']['value'])} %" for role in ROLES)
            yield (f"| {title} | {rate_text(row['before'], False)} | {rate_text(row['after'], True)} | "
                   f"{row['difference']['value']:+.0f} [{low:+.0f}, {high:+.0f}] | {float(row['p']['value']):.2g} | "
                   f"{whole(row['oracle']['value'])} % | {strict} |")


def digests_file(experiment, on_gpu):
    return f"experiments/specs/digests/{experiment}{'.cuda' * on_gpu}.json"


def digests_in_words(digests, on_gpu):
    """Of the last stages: what departs earlier departs there, too. Trials are left out where they wait for a new run."""
    weights = sorted((s["subject"].removeprefix("arm-"), s["sha256"][:12]) for s in digests["stages"]
                     if s["stage"] == "weights" and s["subject"] != "arm-before")
    trials = [s["sha256"][:12] for s in digests["stages"] if s["stage"] == "trials"]
    ends = f"; trials {trials[0]}" if trials else ""
    name = digests["experiment"]
    return (f"`{name}.yaml` as shipped ends {'on a GPU ' * on_gpu}in these digests: weights of "
            f"{', '.join(f'`{arm}` {digest}' for arm, digest in weights)}{ends} "
            f"(found on: {', '.join(digests['confirmed_on'])}). Those of all {len(digests['stages'])} stages are in "
            f"`{digests_file(name, on_gpu)}`.")


def shipped_in_words(record, digests):
    """What the spec as shipped prints: the trainings of the record with its seeds, `.sN` in names of repeated arms."""
    name, trainings = digests["experiment"], rows_of(record, TRAININGS)
    tuned = [s["subject"] for s in digests["stages"] if s["stage"] == "weights" and s["subject"] != "arm-before"]
    repeated = sorted(int(subject.rpartition(".s")[2]) for subject in tuned if ".s" in subject)
    cases = [next(iter(trainings)), *(f"seed {seed}" for seed in repeated)]
    if len(cases) == len(trainings):
        return ""
    counts = [trainings[case]["after"]["count"] for case in cases]
    return (f"`{name}.yaml` as shipped makes those with {', '.join(cases)}: "
            f"{', '.join(str(found) for found, _ in counts)} of {counts[0][1]} episodes. ")


def in_words(record, digests):
    scenes = [title for title in rows_of(record, SUCCESS) if title != "All scenes"]
    trainings = list(rows_of(record, TRAININGS).values())
    gains = [t["won"]["value"] - t["lost"]["value"] for t in trainings]
    successes = sorted(t["after"]["count"][0] for t in trainings)
    trials = trainings[0]["after"]["count"][1]
    before = trainings[0]["after"]["count"][0] - gains[0]
    ap50 = sorted(t["AP50 on held-out views"]["value"] for t in trainings)
    near = sum(t["training views near a start"]["value"] for t in trainings)
    facts = record["facts"]
    yield (f"{' and '.join(scenes)}: {len(trainings)} fine-tunings "
           f"with other seeds, {trials} episodes each; the intervals count how trainings differ (`docs/metrics.md`). After "
           f"fine-tuning {', '.join(map(str, successes))} of {trials} episodes succeed, before {before}: "
           f"{sum(gain > 0 for gain in gains)} of {len(trainings)} trainings are better, the median gain is "
           f"{100 * statistics.median(gains) / trials:+.0f} points. AP50 on held-out views goes from "
           f"{whole(trainings[0]['AP50 before']['value'])} to {whole(ap50[0])} ... {whole(ap50[-1])} (median "
           f"{whole(statistics.median(ap50))}). {shipped_in_words(record, digests)}{near} training views lie near a start of an episode. Success: "
           f"{facts['Success rule']}; the strict rule is {facts['Strict rule']} (STOP within 0.1 m of a view point).")
    processor = record["machine"]["gpu"] or record["machine"]["processor"]
    yield (f"`{record['command']}`, commit {record['commit']}, {processor}, {facts['Kernels']} kernels, "
           f"{record['date']}. {digests_in_words(digests, record['machine']['gpu'] is not None)}")


def headline_text(root, records):
    lines = list(table_lines(records))
    for record in records:
        on_gpu = record["machine"]["gpu"] is not None
        digests = read_json(os.path.join(root, digests_file(record["facts"]["Experiment"], on_gpu)))
        for paragraph in in_words(record, digests):
            lines += ["", wrapped(paragraph)]
    return "\n".join(lines)
