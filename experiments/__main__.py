"""`python -m experiments`: lists the experiments, runs them, makes the page of their results."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from experiments.catalogue import EXPERIMENTS, FOLDER, REQUIRED, Experiment, chosen
from experiments.page import PAGE, write_page
from experiments.results import read_results
from jaxslam.cli.main import unread

_BAD_INPUT = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Lists, runs or makes the page, as the arguments say.

    Args:
        arguments: without the program's name; None takes those of the process.

    Returns:
        The exit code: 0, or 2 for what cannot be done, with a line on stderr.
    """
    given = _parse(arguments)
    try:
        if given.command == "run":
            return _run(given)
        if given.command == "page":
            _make_page()
        else:
            _list()
    except BrokenPipeError:
        return unread()
    except OSError as error:
        return _complain(str(error))
    except ValueError as error:
        # Of an experiment itself it would be a mistake of ours, to be seen in full.
        if given.command == "run":
            raise
        return _complain(str(error))
    return 0


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m experiments", description="Without a command: lists the experiments."
    )
    commands = parser.add_subparsers(dest="command", metavar="{list,run,page}")
    commands.add_parser("list", help="what there is, and which results are there")
    commands.add_parser("page", help=f"collect the results in {PAGE}, beside what the papers show")
    run = commands.add_parser("run", help="run experiments one after the other")
    run.add_argument("names", nargs="*", metavar="NAME", help="which; all of them without any")
    run.add_argument("--out", type=Path, metavar="DIR", help="for results: DIR/NAME, else their own")
    run.add_argument("--smoke", action="store_true", help="tiny versions, to see that they run; needs --out")
    run.add_argument("--seeds", type=int, metavar="N", help="runs of every cell, else as many as each says")
    run.add_argument("--workers", type=int, metavar="N", help="processes side by side")
    run.add_argument("--fresh", action="store_true", help="compute again what the folders have")
    return parser.parse_args(arguments)


def _list() -> None:
    for experiment in EXPERIMENTS.values():
        results = read_results(experiment.results())
        state = f"none yet: {experiment.command}" if results.text is None else results.made_by or "there"
        print(f"{experiment.name} (paper: {experiment.paper}), about {experiment.hours:g} h on two cores")
        print(f"    {_question(experiment)}")
        print(f"    results: {state}")


def _question(experiment: Experiment) -> str:
    try:
        return experiment.question
    except ModuleNotFoundError as error:
        return f"needs {error.name}: {REQUIRED}"


def _run(given: argparse.Namespace) -> int:
    try:
        # Whether all that they need is there shows now, and not after the hours of the first.
        mains = {experiment.name: experiment.main for experiment in chosen(given.names)}
    except ValueError as error:
        return _complain(str(error))
    except ModuleNotFoundError as error:
        return _complain(f"{error.name} is not installed: {REQUIRED}")
    for name, run in mains.items():
        print(f"== {name}", flush=True)
        run(_flags(given, name))
    if given.out is None:
        print("python -m experiments page brings the page of results up to date")
    return 0


def _flags(given: argparse.Namespace, name: str) -> list[str]:
    """Those that an experiment of its own understands."""
    flags = ["--smoke"] if given.smoke else []
    flags += ["--fresh"] if given.fresh else []
    flags += [] if given.seeds is None else ["--seeds", str(given.seeds)]
    flags += [] if given.workers is None else ["--workers", str(given.workers)]
    return flags if given.out is None else [*flags, "--out", str(given.out / name)]


def _make_page() -> None:
    missing = write_page()
    print(f"written to {FOLDER / PAGE}")
    for line in missing:
        print(line)


def _complain(message: str) -> int:
    print(f"experiments: error: {message}", file=sys.stderr)
    return _BAD_INPUT


if __name__ == "__main__":
    sys.exit(main())
