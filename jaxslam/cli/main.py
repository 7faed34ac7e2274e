"""Parse the command line, run a command, and report every error as one line."""

import contextlib
import difflib
import io
import os
import re
import sys
from collections.abc import Callable, Sequence
from typing import Any

_EXTRAS = {
    "cli": ("tyro", "matplotlib", "PIL", "rosbags", "ruamel", "tqdm", "tomlkit", "docstring_parser", "pooch"),
    "train": ("lineax", "optax", "optimistix"),
    "vision": ("skimage",),
    "study": ("optuna", "sqlalchemy", "cmaes", "sklearn"),
    "cluster": ("dask", "distributed"),
}
"""Modules that the commands need in addition to the core, by the extra that installs them."""

_NOT_A_NUMBER = re.compile(
    r"Error parsing (?P<flag>--[\w-]+): "
    r"(?:no type matching \{None\}\||invalid literal for |could not convert string to )"
    r"(?P<type>INT|FLOAT|int\(\)|float)[^'\"]*(?P<value>'[^']*'|\"[^\"]*\")\]?\.?"
)
"""Messages of tyro for a value that is not a number."""

_BAD_INPUT = 2
_INTERRUPTED = 130
_OUTPUT_CLOSED = 141


class UsageError(ValueError):
    """An error in the command line; the message is one line."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the `jaxslam` command.

    Args:
        arguments: arguments without the name of the program; None takes the arguments of the process.

    Returns:
        The exit code: 0; 2 for a wrong command line or unusable data; 130 if interrupted; 141 if the reader
        of the output has closed it.
    """
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    # Pipes and old consoles may not encode the characters of units: replace them instead of failing.
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    try:
        return _dispatch(arguments)
    except KeyboardInterrupt:
        print("\njaxslam: interrupted", file=sys.stderr)
        return _INTERRUPTED
    except BrokenPipeError:
        return _output_closed()
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        extra = next((name for name, modules in _EXTRAS.items() if missing in modules), None)
        if extra is None:
            raise
        return _report(f"{missing} is not installed: pip install 'jaxslam[{extra}]'")
    except OSError as error:
        where = f"{error.filename}: " if error.filename is not None else ""
        return _report(f"{where}{error.strerror or error}")
    except ValueError as error:
        return _report(str(error))
    except OverflowError as error:
        return _report(f"a setting, or a number in a file, is too large or too small: {error}")
    except RecursionError:
        return _report("a file is nested too deeply to be read")


def _dispatch(arguments: Sequence[str]) -> int:
    if list(arguments) in (["--version"], ["-V"]):
        import jaxslam

        print(f"jaxslam {jaxslam.__version__}")
        return 0
    try:
        command = parse(arguments or ["--help"])
    except SystemExit:  # the help was requested and printed
        return 0
    sys.modules[type(command).__module__].execute(command, list(arguments))
    return 0


def parse(arguments: Sequence[str]) -> object:
    """Return the requested command, an instance of a class whose module defines `execute`.

    Raises:
        UsageError: the arguments are wrong.
        SystemExit: the help was requested and printed.
    """
    # Command modules import neither JAX nor matplotlib, so that the help appears at once.
    import tyro

    from jaxslam.cli.config import Config
    from jaxslam.cli.demo import Demo
    from jaxslam.cli.fetch import Fetch
    from jaxslam.cli.fuse import Fuse
    from jaxslam.cli.info import Info
    from jaxslam.cli.localize import Localize
    from jaxslam.cli.run import Run
    from jaxslam.cli.study import Study
    from jaxslam.cli.study_report import StudyReport
    from jaxslam.cli.train_range import TrainRange

    commands: dict[str, Callable[..., Any]] = {
        "run": Run,
        "demo": Demo,
        "fetch": Fetch,
        "localize": Localize,
        "info": Info,
        "config": Config,
        "fuse": Fuse,
        "train-range": TrainRange,
        "study": Study,
        "study-report": StudyReport,
    }
    name = arguments[0] if arguments else ""
    if not name.startswith("-") and name not in commands:
        nearest = difflib.get_close_matches(name, commands, 1, cutoff=0.0)[0]
        raise UsageError(f"no command is called {name!r}: did you mean {nearest!r}? (see --help)")
    message = io.StringIO()
    try:
        with contextlib.redirect_stderr(message):
            return tyro.extras.subcommand_cli_from_dict(
                commands,
                prog="jaxslam",
                description="Grid-based particle-filter SLAM for 2D lidar: from a log to a map.",
                args=_one_value_per_set(_one_word(arguments)),
            )
    except SystemExit as stop:
        if not stop.code:
            raise
        raise UsageError(_one_line(message.getvalue())) from None


def _one_word(arguments: Sequence[str]) -> list[str]:
    """Write `study report` as the command `study-report`, so that both spellings work."""
    return ["study-report", *arguments[2:]] if list(arguments[:2]) == ["study", "report"] else list(arguments)


def _one_value_per_set(arguments: Sequence[str]) -> list[str]:
    """Write `--set a=1 b=2` as `--set a=1 --set b=2`, so that both spellings work."""
    expanded: list[str] = []
    after_set = False
    for argument in arguments:
        if after_set and "=" in argument and not argument.startswith("-"):
            if expanded[-1] != "--set":
                expanded.append("--set")
        else:
            after_set = argument == "--set"
        expanded.append(argument)
    return expanded


def _one_line(box: str) -> str:
    """Return the first sentences of a framed message, up to its first rule, and point to the help."""
    sentences: list[str] = []
    for line in box.splitlines():
        text = line.strip(" │╭╮╰╯─")
        is_frame = line.startswith(("╭", "╰"))
        if not text or line.strip(" │").startswith("──") or text.startswith("For full helptext"):
            if sentences:
                break
        elif not is_frame:
            sentences.append(text)
    message = " ".join(sentences) or "the command line cannot be understood"
    return f"{_NOT_A_NUMBER.sub(_give_a_number, message)} (see --help)"


def _give_a_number(match: re.Match[str]) -> str:
    wanted = "a whole number" if match["type"] in ("INT", "int()") else "a number"
    return f"{match['flag']} is {match['value']}: give {wanted}"


def _output_closed() -> int:
    """Handle a reader that stops early, as `head` does: this is not an error.

    Returns:
        The exit code of a process that is ended by SIGPIPE.
    """
    # At exit, Python would flush the rest of the buffer and report the same error.
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return _OUTPUT_CLOSED


def _report(message: str) -> int:
    print(f"jaxslam: error: {' '.join(message.split())}", file=sys.stderr)
    return _BAD_INPUT
