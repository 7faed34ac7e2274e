"""`python -m experiments`: list the experiments, run them, write the page of their results."""

import argparse
import contextlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from experiments._harness.results import read_results
from experiments.paper_tables.catalogue import EXPERIMENTS, FOLDER, REQUIRED, Experiment, chosen
from experiments.paper_tables.page import PAGE, write_page

_BAD_INPUT = 2
_OUTPUT_CLOSED = 141


def main(arguments: Sequence[str] | None = None) -> int:
    """List the experiments, run them, or write the page, as the arguments ask.

    Args:
        arguments: the arguments without the program's name; None takes the arguments of the process.

    Returns:
        The exit code: 0; 2 after an error, which is printed on stderr; 141 if the reader of the output has
        closed it.
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
        return _output_closed()
    except OSError as error:
        return _complain(str(error))
    except ValueError as error:
        # A ValueError of an experiment is a defect, so its traceback is shown.
        if given.command == "run":
            raise
        return _complain(str(error))
    return 0


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m experiments", description="Without a command, list the experiments."
    )
    commands = parser.add_subparsers(dest="command", metavar="{list,run,page}")
    commands.add_parser("list", help="list the experiments and the state of their results")
    commands.add_parser("page", help=f"write {PAGE}, which compares the results with the papers")
    run = commands.add_parser("run", help="run experiments one after another")
    run.add_argument("names", nargs="*", metavar="NAME", help="experiments to run; default: all")
    run.add_argument("--out", type=Path, metavar="DIR", help="write results to DIR/NAME")
    run.add_argument("--smoke", action="store_true", help="run tiny versions as a check; needs --out")
    run.add_argument("--seeds", type=int, metavar="N", help="number of runs of each cell")
    run.add_argument("--workers", type=int, metavar="N", help="parallel processes")
    run.add_argument("--fresh", action="store_true", help="recompute cells that the folders already have")
    return parser.parse_args(arguments)


def _list() -> None:
    for experiment in EXPERIMENTS.values():
        results = read_results(experiment.results())
        state = f"none yet: {experiment.command}" if results.text is None else results.made_by or "complete"
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
        # A missing dependency is reported now, and not after the hours of the first experiment.
        mains = {experiment.name: experiment.main for experiment in chosen(given.names)}
    except ValueError as error:
        return _complain(str(error))
    except ModuleNotFoundError as error:
        return _complain(f"{error.name} is not installed: {REQUIRED}")
    for name, run in mains.items():
        print(f"== {name}", flush=True)
        run(_flags(given, name))
    if given.out is None:
        print("Update the page of results: python -m experiments page")
    return 0


def _flags(given: argparse.Namespace, name: str) -> list[str]:
    """Return the flags for one experiment."""
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


def _output_closed() -> int:
    """Handle a reader that stops early, as `head` does: this is not an error."""
    # At exit, Python would flush the rest of the buffer and report the same error.
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return _OUTPUT_CLOSED


def _complain(message: str) -> int:
    print(f"experiments: error: {message}", file=sys.stderr)
    return _BAD_INPUT


if __name__ == "__main__":
    sys.exit(main())
