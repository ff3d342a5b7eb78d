"""Records of measurements: results/SUBJECT/NAME.json, read and checked. results/README.md tells the format."""
import collections
import decimal
import json
import os
import re
import statistics

SCHEMA = "segsim.record/1"
SUBJECT_SCHEMA = "segsim.subject/1"
ORIGIN = ("command", "commit", "date", "machine")
FIELDS = {"schema", "title", *ORIGIN, "note", "not_recorded", "facts", "values"}
MACHINE_FIELDS = {"processor", "cores", "gpu", "conditions"}
VALUE_FIELDS = {"table", "case", "name", "unit", "value", "interval95", "range", "count", "runs", "goal"}
GOAL_FIELDS = {"at_most", "at_least", "is", "aim"}
NUMBER = (int, float, decimal.Decimal)
NAME = re.compile(r"[a-z0-9_]+")


class BadRecord(Exception):
    """The message is one line: file, place, what was expected and what was found."""


def expect(holds, place, expected, found):
    if not holds:
        raise BadRecord(f"{place}: expected {expected}, found {json.dumps(found, default=float)}")


def is_number(value):
    return isinstance(value, NUMBER) and not isinstance(value, bool)


def is_text(value):
    return isinstance(value, str) and value.strip() != ""


def expect_fields(place, data, allowed, needed):
    expect(isinstance(data, dict), place, "an object", data)
    for key in data:
        expect(key in allowed, place, "the keys " + ", ".join(sorted(allowed)), key)
    for key in needed:
        expect(key in data, place, f'"{key}" (null where it was not recorded)', sorted(data))


def expect_paragraphs(place, data):
    expect(isinstance(data, list) and all(is_text(p) for p in data), place, "a list of paragraphs", data)


def expect_pair(place, pair):
    expect(isinstance(pair, list) and len(pair) == 2 and all(map(is_number, pair)) and pair[0] <= pair[1], place,
           "[low, high]", pair)


def check_goal(place, value):
    goal = value["goal"]
    expect_fields(place, goal, GOAL_FIELDS, ())
    bars = [key for key in ("at_most", "at_least", "is") if key in goal]
    expect(len(bars) == 1, place, "one of at_most, at_least, is", sorted(goal))
    bar = goal[bars[0]]
    if bars[0] == "is":
        expect(isinstance(bar, (bool, int)) and "aim" not in goal, place, "true, false or a whole number, no aim", goal)
    else:
        expect(is_number(bar), place, "a number", bar)
        expect(is_number(goal.get("aim", 0)), place, "a number as aim", goal.get("aim"))
    measured = value["value"]
    expect(measured is None or isinstance(measured, bool) or is_number(measured), place,
           "a goal only for a number, true, false or null", measured)


def check_value(place, value):
    expect_fields(place, value, VALUE_FIELDS, ("name", "unit", "value"))
    for key in ("table", "case", "name"):
        expect(key not in value or is_text(value[key]), f"{place}.{key}", "text", value.get(key))
    expect(isinstance(value["unit"], str), f"{place}.unit", 'a unit ("" for none)', value["unit"])
    v = value["value"]
    expect(v is None or isinstance(v, (str, bool)) or is_number(v), f"{place}.value", "a number, true, false, a word or null",
           v)
    for key in ("interval95", "range"):
        if key in value:
            expect_pair(f"{place}.{key}", value[key])
    if "count" in value:
        count = value["count"]
        expect(isinstance(count, list) and len(count) == 2 and all(isinstance(n, int) for n in count) and
               0 <= count[0] <= count[1] and count[1] > 0, f"{place}.count", "[successes, trials]", count)
        share = 100 * count[0] / count[1]
        expect(value["unit"] == "%" and is_number(v) and abs(float(v) - share) < 0.51, f"{place}.value",
               f"{share:.2f} with the unit %, as counted", v)
    if "runs" in value:
        runs = value["runs"]
        expect(isinstance(runs, list) and len(runs) > 1 and all(map(is_number, runs)), f"{place}.runs", "several numbers", runs)
        expect(is_number(v) and v == statistics.median(runs), f"{place}.value", f"the median {statistics.median(runs)} of the runs",
               v)
    if "goal" in value:
        check_goal(f"{place}.goal", value)


def check_record(place, record):
    expect_fields(place, record, FIELDS, ("schema", "title", *ORIGIN, "values"))
    expect(record["schema"] == SCHEMA, f"{place}: schema", SCHEMA, record["schema"])
    expect(is_text(record["title"]), f"{place}: title", "text", record["title"])
    command = record["command"]
    expect(command is None or is_text(command) or isinstance(command, list) and command and all(map(is_text, command)),
           f"{place}: command", "a command line, several, or null", command)
    commit = record["commit"]
    expect(commit is None or isinstance(commit, str) and re.fullmatch(r"[0-9a-f]{7,40}(-dirty)?", commit),
           f"{place}: commit", "a hash of 7 to 40 digits or null", commit)
    date = record["date"]
    expect(date is None or isinstance(date, str) and re.fullmatch(r"\d{4}-\d\d-\d\d", date), f"{place}: date",
           "YYYY-MM-DD or null", date)
    machine = record["machine"]
    expect_fields(f"{place}: machine", machine, MACHINE_FIELDS, ("processor", "cores", "gpu"))
    for key in ("processor", "gpu", "conditions"):
        expect(machine.get(key) is None or is_text(machine[key]), f"{place}: machine.{key}", "text or null", machine.get(key))
    expect(machine["cores"] is None or isinstance(machine["cores"], int) and machine["cores"] > 0,
           f"{place}: machine.cores", "a number of cores or null", machine["cores"])
    expect_paragraphs(f"{place}: note", record.get("note", []))
    reasons = record.get("not_recorded", {})
    expect(isinstance(reasons, dict) and all(key in ORIGIN and is_text(why) for key, why in reasons.items()),
           f"{place}: not_recorded", "a sentence for some of " + ", ".join(ORIGIN), reasons)
    facts = record.get("facts", {})
    expect(isinstance(facts, dict) and all(is_text(fact) for fact in facts.values()), f"{place}: facts", "texts by name", facts)
    expect(isinstance(record["values"], list) and record["values"], f"{place}: values", "a list of values",
           record["values"])
    seen = set()
    for i, value in enumerate(record["values"]):
        check_value(f"{place}: values[{i}]", value)
        key = (value.get("table"), value.get("case"), value["name"])
        expect(key not in seen, f"{place}: values[{i}]", "another table, case or name than every value before", key)
        seen.add(key)


def in_table(record, name):
    return any(value["name"] == name for value in record["values"])


def lacking(record):
    """What of its origin neither the record nor a column of its tables tells. A number of cores is no machine."""
    machine = record["machine"]
    told = {**record, "machine": machine["processor"] or machine["gpu"]}
    return [key for key in ORIGIN if told[key] is None and not in_table(record, key)]


def read_json(path):
    try:
        with open(path) as file:
            return json.load(file, parse_float=decimal.Decimal)
    except json.JSONDecodeError as error:
        raise BadRecord(f"{path}:{error.lineno}: {error.msg}") from None
    except OSError as error:
        raise BadRecord(f"{path}: {error.strerror}") from None


def read_record(path):
    record = read_json(path)
    check_record(path, record)
    return record


Subject = collections.namedtuple("Subject", "name title note records")  # records: name -> record, in order of the page


def read_subject(root, name):
    folder = os.path.join(root, "results", name)
    place = os.path.join(folder, "index.json")
    index = read_json(place)
    expect_fields(place, index, {"schema", "title", "note", "records"}, ("schema", "title", "note", "records"))
    expect(index["schema"] == SUBJECT_SCHEMA, f"{place}: schema", SUBJECT_SCHEMA, index["schema"])
    expect(is_text(index["title"]), f"{place}: title", "text", index["title"])
    expect_paragraphs(f"{place}: note", index["note"])
    expect(isinstance(index["records"], list) and all(isinstance(n, str) and NAME.fullmatch(n) for n in index["records"]),
           f"{place}: records", "names of records, in the order of the page", index["records"])
    there = {file[:-len(".json")] for file in os.listdir(folder) if file.endswith(".json")} - {"index"}
    expect(there == set(index["records"]) and len(there) == len(index["records"]), f"{place}: records",
           f"every record of the folder once: {', '.join(sorted(there))}", index["records"])
    return Subject(name, index["title"], index["note"],
                   {n: read_record(os.path.join(folder, n + ".json")) for n in index["records"]})


def read_index(root):
    """The subjects, in the order of results/index.json, and the known limits."""
    place = os.path.join(root, "results", "index.json")
    index = read_json(place)
    expect_fields(place, index, {"subjects", "limits"}, ("subjects", "limits"))
    names = index["subjects"]
    there = {entry.name for entry in os.scandir(os.path.join(root, "results")) if entry.is_dir()}
    expect(isinstance(names, list) and all(isinstance(n, str) for n in names) and sorted(names) == sorted(there),
           f"{place}: subjects", f"the names of the folders: {', '.join(sorted(there))}", names)
    expect_paragraphs(f"{place}: limits", index["limits"])
    return [read_subject(root, name) for name in names], index["limits"]


def is_held(value):
    """Whether a value with a goal keeps to it; None if it was not measured."""
    goal, measured = value["goal"], value["value"]
    if measured is None:
        return None
    if "at_most" in goal:
        return measured <= goal["at_most"]
    if "at_least" in goal:
        return measured >= goal["at_least"]
    return measured == goal["is"]


def reaches_aim(value):
    goal, measured = value["goal"], value["value"]
    if "aim" not in goal or measured is None:
        return None
    return measured <= goal["aim"] if "at_most" in goal else measured >= goal["aim"]


def json_line(data):
    return json.dumps(data, ensure_ascii=False, default=float)


def record_text(record):
    """As it is stored: a field or a value a line, so that a difference shows what was measured anew."""
    lines = []
    for key, field in record.items():
        if key == "values":
            lines.append(' "values": [\n' + ",\n".join("  " + json_line(value) for value in field) + "\n ]")
        elif key in ("note", "command") and isinstance(field, list) and field:
            lines.append(f' "{key}": [\n' + ",\n".join("  " + json_line(part) for part in field) + "\n ]")
        else:
            lines.append(f' "{key}": {json_line(field)}')
    return "{\n" + ",\n".join(lines) + "\n}\n"


def write_atomically(path, text):
    os.makedirs(os.path.dirname(path) or ".", exist_ok=True)
    with open(path + ".part", "w") as file:
        file.write(text)
    os.replace(path + ".part", path)


def write_record(path, record):
    check_record(path, json.loads(record_text(record), parse_float=decimal.Decimal))
    write_atomically(path, record_text(record))
