#!/usr/bin/env python3
"""Of programs that write records: tools/results reads them, and they name the command.

  program_records_test.py PROGRAM [ARGUMENT...]     the record goes to a file that --record=FILE names
"""
import os
import pathlib
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "tools" / "results"))

from record import read_record  # noqa: E402


def main(program, *arguments):
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "new.json")
        subprocess.run([program, *arguments, f"--record={path}"], check=True, stdout=subprocess.DEVNULL)
        record = read_record(path)
    called = " ".join([os.path.basename(program), *arguments])
    if record["command"] != called:
        sys.exit(f"command: expected {called}, found {record['command']}")
    if not all(value["value"] is not None for value in record["values"]):
        sys.exit("expected a number for every value")
    print(f"{len(record['values'])} values, commit {record['commit']}, {record['machine']['processor']}")


if __name__ == "__main__":
    main(*sys.argv[1:])
