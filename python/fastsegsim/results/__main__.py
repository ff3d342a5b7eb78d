"""Results of a run in the formats of other programs: `python -m fastsegsim.results lerobot | parquet RUN FOLDER`."""

import argparse
import sys

from fastsegsim._native import InputError
from fastsegsim.results.lerobot_export import STORAGES, export_lerobot
from fastsegsim.results.stored_run import load_run
from fastsegsim.results.trial_recording import IMAGES


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m fastsegsim.results", description=__doc__.splitlines()[0])
    formats = parser.add_subparsers(dest="format", required=True)
    lerobot = formats.add_parser("lerobot", help="trials as a LeRobot data set v3.0")
    parquet = formats.add_parser("parquet", help="trials, arms and rates as Parquet files")
    for chosen in (lerobot, parquet):
        chosen.add_argument("run", metavar="RUN", help="work folder of `segsim run`, or its results.sqlite")
        chosen.add_argument("folder", metavar="FOLDER", help="for the files")
        chosen.add_argument("--run-id", type=int, default=0, help="number of the run; default: the last")
    lerobot.add_argument("--images", choices=IMAGES, default="auto", help="default: recorded ones, else drawn again")
    lerobot.add_argument("--storage", choices=STORAGES, default="video", help="default: video, which needs PyAV")
    lerobot.add_argument("--arms", nargs="+", help="default: all")
    lerobot.add_argument("--successes-only", action="store_true", help="leave failed trials out")
    return parser


def main() -> None:
    arguments = _parser().parse_args()
    try:
        run = load_run(arguments.run, arguments.run_id)
        if arguments.format == "parquet":
            for file in run.to_parquet(arguments.folder):
                print(file)
            return
        made = export_lerobot(run, arguments.folder, arguments.images, arguments.storage, arguments.arms,
                              arguments.successes_only)
        print(f"{made.root}: {made.episodes} episodes, {made.frames} frames, {len(made.tasks)} tasks, "
              f"images {made.images}")
    except (ImportError, InputError, OSError) as error:  # Also a module that is missing, and a full disk.
        print(error, file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
