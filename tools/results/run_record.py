"""The record of a finished `segsim run`, from its table.json and digests.json."""
import os
import re
import statistics

from record import SCHEMA, BadRecord, read_json

STRICT = "habitat-hm3d"
SUCCESS, TRAININGS, CLASSES = "Success", "Trainings", "By goal class"
ROLES = ("before", "after", "oracle")


def hundredths(number):
    return round(float(number), 2)


def figures(number, count=3):
    return float(f"{float(number):.{count}g}")


def value(name, unit, measured, **more):
    return {**{key: more[key] for key in ("table", "case") if key in more}, "name": name, "unit": unit,
            "value": measured, **{key: more[key] for key in more if key not in ("table", "case")}}


def rate(name, arm, **place):
    low, high = arm.get("hierarchical95") or arm["wilson95"]
    return value(name, "%", hundredths(100 * arm["sr"]), interval95=[hundredths(100 * low), hundredths(100 * high)],
                 count=[arm["successes"], arm["episodes"]], **place)


def points(name, number, interval, **place):
    return value(name, "points", hundredths(100 * number), interval95=[hundredths(100 * end) for end in interval], **place)


def success_values(table, group, title):
    place = {"table": title, "case": group["title"]}
    comparison = group["comparison"]
    for role in ROLES:
        yield rate(role, group["arms"][table[role]], **place)
    yield points("difference", comparison["difference"], comparison.get("hierarchical95") or comparison["newcombe95"],
                 **place)
    yield value("won", "pairs", comparison["only_after"], **place)
    yield value("lost", "pairs", comparison["only_before"], **place)
    p = "p_holm" if title == CLASSES else "p_trainings" if "p_trainings" in comparison else "p_mcnemar_exact"
    yield value("p (Holm)" if title == CLASSES else "p", "", figures(comparison[p], 2), **place)


def strict_values(table, group):
    for role in ROLES:
        yield value(f"{role}, {STRICT}", "%", hundredths(100 * group["arms"][table[role]]["profiles"][STRICT]["sr"]),
                    table=SUCCESS, case=group["title"])


def training_values(table, training):
    arms = table["provenance"]["arms"]
    arm, before = arms[training["arm"]], arms[training["before"]]
    place = {"table": TRAININGS, "case": f"seed {training['seed']}"}
    yield value("weights", "", arm["weights_sha256"][:12], **place)
    yield value("after", "%", hundredths(100 * training["sr"]), count=[training["successes"], training["episodes"]], **place)
    yield value("won", "pairs", training["only_after"], **place)
    yield value("lost", "pairs", training["only_before"], **place)
    yield value("AP50 on held-out views", "%", hundredths(100 * arm["held_out"]["ap50"]), **place)
    yield value("AP50 before", "%", hundredths(100 * before["held_out"]["ap50"]), **place)
    yield value("score threshold", "", figures(arm["held_out"]["score_threshold"]), **place)
    yield value("training views near a start", "views", arm["tuning_views"]["near_starts"], **place)


def arms_of(table, groups):
    return [(f"{group['title']}, {role}", group["arms"][table[role]]) for group in groups for role in ROLES]


def course_values(case, arm):
    place = {"table": "How the trials went", "case": case}
    for name, unit, number in (("SPL", "", arm["spl"]), ("SoftSPL", "", arm["soft_spl"]), ("time", "s", arm["sim_s"]),
                               ("path", "m", arm["path_m"]), ("contacts", "", arm["contacts"]),
                               ("holes in the image", "%", 100 * arm["invalid_pixels"])):
        yield value(name, unit, figures(number), **place)
    yield value("outcomes", "", ", ".join(f"{name} {count}" for name, count in
                                          sorted(arm["outcomes"].items(), key=lambda item: -item[1])), **place)


def paired_values(group):
    for name, unit in (("spl", ""), ("sim_s", "s"), ("path_m", "m")):
        paired = group["comparison"]["paired"][name]
        place = {"table": "After minus before on the same episodes", "case": group["title"]}
        word = {"spl": "SPL", "sim_s": "time", "path_m": "path"}[name]
        yield value(word, unit, figures(paired['mean']), interval95=[
            figures(end) for end in paired.get("hierarchical95") or paired["bootstrap95"]], **place)
        yield value(f"p, {word}", "", figures(paired.get('p_trainings', paired.get('p_sign_flip')), 2), **place)


def cause_values(case, arm, causes):
    place = {"table": "Why trials failed", "case": case}
    yield value("failed", "trials", arm["episodes"] - arm["successes"], **place)
    for cause in causes:
        yield value(cause, "trials", arm.get("causes", {}).get(cause, 0), **place)


def perception_values(case, arm):
    place = {"table": "What the detector made of the goal", "case": case}
    seen = arm["perception"]
    yield value("recall in view", "", float(f"{seen['detected_frames'] / max(1, seen['visible_frames']):.2f}"), **place)
    yield value("saw it", "trials", seen["saw_goal"], **place)
    yield value("never detected it", "trials", seen["never_detected"], **place)
    if "median_delay_ticks" in seen:
        yield value("delay", "ticks", seen["median_delay_ticks"], **place)
    yield value("false detections in 100 images", "", figures(100 * seen['false_detections'] / seen['frames']),
                **place)
    yield value("false objects", "per trial", figures(seen['false_objects_per_trial']), **place)
    yield value("misplaced objects", "per trial", figures(seen.get('misplaced_objects_per_trial', 0)), **place)


def rule_values(case, arm):
    place = {"table": "The same trials under named success rules (success rate; SPL as that rule defines it)", "case": case}
    for name, profile in arm["profiles"].items():
        yield value(name, "%", figures(100 * profile['sr']), **place)
        yield value(f"SPL, {name}", "", figures(profile['spl'], 2), **place)


def detector_values(name, arm):
    place = {"table": "Detectors on held-out views of the scenes", "case": name}
    held_out = arm["held_out"]
    yield value("views", "", held_out["views"], **place)
    for key, word in (("ap50", "AP50"), ("ap", "AP"), ("precision", "precision"), ("recall", "recall")):
        yield value(word, "%", figures(100 * held_out[key]), **place)
    for key, word in (("source_ap50", "AP50 in source rooms"), ("unseen_ap50", "AP50 in unseen homes")):
        if key in held_out:
            yield value(word, "%", figures(100 * held_out[key]), **place)


def spread_values(table):
    place = {"table": "Spread of the trainings"}
    yield value("standard deviation of the success rate between trainings", "points",
                hundredths(100 * table["training_rate_sd"]), **place)
    gains = [(t["only_after"] - t["only_before"]) / t["episodes"] for t in table["trainings"]]
    yield value("trainings that are better than before", "trainings", sum(gain > 0 for gain in gains), **place)
    yield value("median gain of a training", "points", hundredths(100 * statistics.median(gains)), **place)


def stop_region_values(region):
    place = {"table": "Leakage by view"}
    near = f"successful trials that ended within {region['radius_m']:g} m of a training view of the goal"
    yield value(near, "trials", region["near_views"], **place)
    yield value("successful trials", "trials", region["successes"], **place)
    yield value("such views of a successful trial, mean", "views", figures(region["mean_views"]), **place)


def values_of(table):
    scenes = table["scenes"]
    groups = scenes + ([table["all"]] if table.get("all") else [])
    for group in groups:
        yield from success_values(table, group, SUCCESS)
        yield from strict_values(table, group)
    for training in table["trainings"]:
        yield from training_values(table, training)
    yield from spread_values(table)
    if "stop_region" in table:
        yield from stop_region_values(table["stop_region"])
    for group in table["classes"]:
        yield from success_values(table, group, CLASSES)
    arms = arms_of(table, scenes)
    for case, arm in arms:
        yield from course_values(case, arm)
    for group in groups:
        yield from paired_values(group)
    causes = list(dict.fromkeys(cause for _, arm in arms for cause in arm.get("causes", {})))
    for case, arm in arms:
        yield from cause_values(case, arm, causes)
    for case, arm in arms:
        yield from perception_values(case, arm)
    for case, arm in arms:
        yield from rule_values(case, arm)
    for name, arm in table["provenance"]["arms"].items():
        if "held_out" in arm:
            yield from detector_values(name, arm)


def commit_of(version):
    """Of "0.1.0 (3c3ef21)"."""
    found = re.search(r"\(([0-9a-f]{7,40}(?:-dirty)?)\)", version)
    return found[1] if found else None


def cores_here():
    return len(os.sched_getaffinity(0))


def run_record(work, command):
    """To be called on the machine that ran it: its number of cores is looked up."""
    table = read_json(os.path.join(work, "table.json"))
    digests = read_json(os.path.join(work, "digests.json"))
    provenance = table["provenance"]
    return {"schema": SCHEMA, "title": table["title"], "command": command, "commit": commit_of(provenance["code_version"]),
            "date": provenance["ended"][:10],
            "machine": {"processor": provenance["host"].split(", ", 1)[-1], "cores": cores_here(), "gpu": None},
            "note": [],
            "facts": {"Experiment": digests["experiment"], "Kernels": digests["machine"]["kernels"],
                      "Success rule": provenance["success_profile"], "Strict rule": STRICT,
                      "SHA-256 of all trials": digests["stages"][-1]["sha256"],
                      "SHA-256 of the spec": provenance["spec_sha256"]},
            "values": list(values_of(table))}


def joined(records, paths):
    """One record of several commands, which must agree in commit and machine; the day is that of the last."""
    first = records[0]
    for record, path in zip(records[1:], paths[1:]):
        for key in ("commit", "machine"):
            if record[key] != first[key]:
                raise BadRecord(f"{path}: {key}: expected that of {paths[0]}, found {record[key]}")
    commands = [record["command"] for record in records]
    return {**first, "command": commands[0] if len(records) == 1 else commands, "date": records[-1]["date"],
            "values": [value for record in records for value in record["values"]]}


def keep_words(new, old):
    """A record measured anew keeps the title, the note and the goals of the one whose place it takes, but for goals of its
    own: some depend on what was measured."""
    goals = {(v.get("table"), v.get("case"), v["name"]): v["goal"] for v in old["values"] if "goal" in v}
    values = [{**v, "goal": goals[key]}
              if (key := (v.get("table"), v.get("case"), v["name"])) in goals and "goal" not in v else v
              for v in new["values"]]
    return {**new, "title": old["title"], "note": old.get("note", []), "values": values}
