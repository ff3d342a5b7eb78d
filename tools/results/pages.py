"""Markdown from records: a page for each subject, the index, the goals, and tables inside other pages."""
import decimal
import textwrap

from record import in_table, is_held, is_number, reaches_aim

WIDTH = 120
MADE = "<!-- Made from results/{} by `python3 tools/results write .`: change the records, not this page. -->"


SHARES = ("%", "points")  # Shown with one decimal: more would be precise about chance.


def number_text(value, unit=""):
    """As recorded, if it has at most five digits; else the first four that count. Thousands apart: 18 000."""
    number = decimal.Decimal(str(value))
    if unit in SHARES and number.as_tuple().exponent < -1:
        number = round(number, 1)
    elif number != number.to_integral_value() and len(number.as_tuple().digits) > 5:
        number = round(number, 1) if abs(number) >= 1000 else decimal.Decimal(f"{number:.4g}")
    if number != 0 and abs(number) < decimal.Decimal("0.0001"):
        return f"{number:.1e}"
    text = f"{number:f}"
    whole, dot, rest = text.partition(".")
    if len(whole.lstrip("-")) > 4:
        whole = f"{int(whole):,}".replace(",", " ")
    return whole + dot + rest


def words_of(value, unit=""):
    if value is None:
        return "not measured"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return number_text(value, unit) if is_number(value) else value


def percent_text(number):
    return f"{float(number):.0f}" if abs(number) >= 10 else f"{float(number):.2g}"


def value_text(value, with_unit):
    """"35/40 = 88 % [74, 95]", "3.5 ms (3.1 to 3.6)"."""
    text = words_of(value["value"], value["unit"])
    unit = f" {value['unit']}" if with_unit and value["unit"] and value["value"] is not None else ""
    if "count" in value:
        text = f"{value['count'][0]}/{value['count'][1]} = {percent_text(value['value'])}"
        unit = " %"
    text += unit
    if "interval95" in value:
        ends = [percent_text(end) if "count" in value else number_text(end, value["unit"]) for end in value["interval95"]]
        text += f" [{', '.join(ends)}]"
    if "range" in value:
        text += f" ({' to '.join(number_text(end) for end in value['range'])})"
    if "runs" in value:
        text += f" ({number_text(min(value['runs']))} to {number_text(max(value['runs']))}, {len(value['runs'])} runs)"
    return text


def goal_text(goal, unit):
    tail = f" {unit}" if unit else ""
    if "is" in goal:
        return words_of(goal["is"]) + tail
    word = "at most" if "at_most" in goal else "at least"
    text = f"{word} {number_text(goal.get('at_most', goal.get('at_least')))}{tail}"
    if "aim" in goal:
        text += f" (aim: {number_text(goal['aim'])})"
    return text


def state_text(value):
    held = is_held(value)
    if held is None:
        return "not measured"
    text = "held" if held else "**missed**"
    aim = reaches_aim(value)
    return text if aim is None else text + (", aim reached" if aim else ", aim missed")


def table_text(header, rows):
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows])


def plain_table(values):
    """Values without cases: a row for each."""
    goals = any("goal" in value for value in values)
    rows = []
    for value in values:
        row = [value["name"], value_text(value, True)]
        if goals:
            goal = value.get("goal")
            row += [goal_text(goal, value["unit"]), state_text(value)] if goal else ["", ""]
        rows.append(row)
    return table_text(["", "measured"] + (["goal", "state"] if goals else []), rows)


def case_table(values):
    """A row for each case, a column for each name; the goal stands behind the column that it is for."""
    cases = list(dict.fromkeys(value.get("case", "all") for value in values))
    names = list(dict.fromkeys(value["name"] for value in values))
    found = {(value.get("case", "all"), value["name"]): value for value in values}
    header, units, with_goal = [""], {}, set()
    for name in names:
        column = [value for value in values if value["name"] == name]
        all_units = {value["unit"] for value in column if value["value"] is not None}
        units[name] = len(all_units) > 1
        unit = "" if units[name] else next(iter(all_units), "")
        header.append(name + (f" [{unit}]" if unit and not any("count" in value for value in column) else ""))
        if any("goal" in value for value in column):
            with_goal.add(name)
            header.append("goal")
    rows = []
    for case in cases:
        row = [case]
        for name in names:
            value = found.get((case, name))
            row.append(value_text(value, units[name]) if value else "")
            if name in with_goal:
                goal = value.get("goal") if value else None
                row.append(f"{goal_text(goal, value['unit'] if units[name] else '')}: {state_text(value)}" if goal else "")
        rows.append(row)
    return table_text(header, rows)


def record_tables(record, level):
    """The tables of a record, each below its heading if it has one."""
    parts = []
    for title in dict.fromkeys(value.get("table") for value in record["values"]):
        values = [value for value in record["values"] if value.get("table") == title]
        if title:
            parts.append("#" * level + " " + title)
        parts.append(case_table(values) if any("case" in value for value in values) else plain_table(values))
    return parts


def wrapped(paragraph):
    if paragraph.startswith(("    ", "![", "|")):
        return paragraph
    return textwrap.fill(paragraph, WIDTH, subsequent_indent="  " if paragraph.startswith("- ") else "",
                         break_long_words=False, break_on_hyphens=False)


def paragraphs(note):
    """Items of a list stay together."""
    text = ""
    for before, paragraph in zip([""] + note, note):
        text += ("\n" if before.startswith("- ") and paragraph.startswith("- ") else "\n\n") + wrapped(paragraph)
    return text.lstrip("\n")


def machine_text(record):
    machine = record["machine"]
    parts = [machine["gpu"], machine["processor"] or ("machines in the table" if in_table(record, "machine") else None)]
    if machine["cores"]:
        parts.append(f"{machine['cores']} cores" if machine["cores"] > 1 else "1 core")
    parts.append(machine.get("conditions"))
    return ", ".join(part for part in parts if part) or "machine not recorded"


def provenance_text(record, more=""):
    commit = "Commits in the table" if in_table(record, "commit") else "Commit not recorded"
    if record["commit"]:
        commit = f"Commit {record['commit']}"
    text = f"{commit}; {record['date'] or 'date not recorded'}; {machine_text(record)}."
    if record["command"] is None:
        text += " The command was not recorded."
    return wrapped(text + more)


def record_section(record, level):
    parts = ["#" * level + " " + record["title"]]
    if record["command"] is not None:
        commands = record["command"] if isinstance(record["command"], list) else [record["command"]]
        parts.append("\n".join("    " + command for command in commands))
    parts.append(provenance_text(record, "".join(f" {why}" for why in record.get("not_recorded", {}).values())))
    if record.get("note"):
        parts.append(paragraphs(record["note"]))
    parts += record_tables(record, level + 1)
    if record.get("facts"):
        parts.append("\n".join(wrapped(f"- {name}: {fact}") for name, fact in record["facts"].items()))
    return "\n\n".join(parts)


def subject_page(subject):
    sections = [record_section(record, 2) for record in subject.records.values()]
    return "\n\n".join([f"# {subject.title}", MADE.format(subject.name + "/*.json"), paragraphs(subject.note)] + sections) + "\n"


def subject_goals(subject):
    return [(record, value) for record in subject.records.values() for value in record["values"] if "goal" in value]


def count_states(goals):
    states = [is_held(value) for _, value in goals]
    return states.count(True), states.count(False), states.count(None)


def state_words(held, missed, unknown):
    text = f"{held} held, {missed} missed"
    return text + (f", {unknown} not measured" if unknown else "")


def results_index(subjects, limits):
    rows = []
    for subject in subjects:
        dates = [record["date"] for record in subject.records.values() if record["date"]]
        goals = subject_goals(subject)
        rows.append([f"[{subject.title}](results/{subject.name}.md)", str(len(subject.records)),
                     state_words(*count_states(goals)) if goals else "none", max(dates, default="not recorded")])
    note = ["Every figure that this project states about itself comes from a record in `results/`: what was run, on which "
            "machine, at which commit, what came out, and which goal it was held to. The pages below are made from the "
            "records and show the newest figures only. Older figures are in the history of the records.",
            "`results/README.md` tells how to write a record, [Goals](goals.md) lists everything that is aimed at, and "
            "[What was changed after looking at results](history_of_the_headline.md) tells how the recipe of the first "
            "page was chosen."]
    return "\n\n".join(["# Results", MADE.format("*/*.json"), paragraphs(note),
                        table_text(["subject", "records", "goals", "newest record"], rows),
                        "## Known limits", paragraphs(["- " + limit for limit in limits])]) + "\n"


def goals_page(subjects):
    everything = [goal for subject in subjects for goal in subject_goals(subject)]
    note = ["What this project aims at, and how far it has come. Each row is a figure of a record that has a goal; whether the "
            "goal is held is computed from the two numbers. Where a goal names an aim as well, the first number must be "
            "kept and the aim would be welcome.", f"In all: {state_words(*count_states(everything))}."]
    parts = ["# Goals", MADE.format("*/*.json"), paragraphs(note)]
    for subject in subjects:
        rows = []
        for record, value in subject_goals(subject):
            what = ": ".join(part for part in (value.get("case"), value["name"]) if part)
            rows.append([record["title"], what, value_text(value, True), goal_text(value["goal"], value["unit"]),
                         state_text(value)])
        if rows:
            parts += [f"## [{subject.title}](results/{subject.name}.md)",
                      table_text(["measurement", "figure", "measured", "goal", "state"], rows)]
    return "\n\n".join(parts) + "\n"


def marked_record(record, subject, to_docs):
    """A record's tables and origin, for a page that includes them."""
    link = f"{to_docs}results/{subject}.md"
    return "\n\n".join(record_tables(record, 4) + [provenance_text(record, f" More: [{record['title']}]({link}).")])
