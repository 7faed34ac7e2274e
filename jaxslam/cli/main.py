"""Parse the command line, run a command, and report every error as one line."""

import contextlib
import importlib
import io
import itertools
import os
import re
import sys
import textwrap
from collections.abc import Sequence
from typing import Any

from jaxslam.core.names import MissingExtraError, check_names, did_you_mean, optional_import

COMMANDS = {
    "run": "Map a log: CARMEN (.log, .clf, also .gz), ROS 1 bag, ROS 2 bag (.mcap, .db3 or folder).",
    "demo": "Map a simulated hall and compare the result with the ground truth; needs no data.",
    "fetch": "Download a public log, verify and convert it. Without NAME, list the public logs.",
    "localize": "Find and track the robot of a log on a known map, by adaptive Monte Carlo localization.",
    "info": "Show what is in a log: counts, rates, beams, ranges, path, gaps.",
    "config": "Print the configuration as TOML with a comment for each setting, for use with `run --config`.",
    "fuse": "Fuse wheel odometry and IMU of a log with a Kalman filter, and write the trajectory.",
    "train-range": "Train a network to correct a lidar's ranges, on readings of a wall at known distances.",
    "study": "Tune settings over many runs, as described in a file; `study report STORAGE` prints results.",
    "study-report": "Write tables, pictures and the best configuration of a study, finished or not.",
}
"""What each command does. The module of the same name in `jaxslam.cli` has its flags and its `execute`."""

_INTERVALS = {
    "particles": (1, sys.maxsize, "1 or more"),
    "trials": (1, sys.maxsize, "1 or more"),
    "seed": (0, 2**32 - 1, "0 to 4294967295"),
}
"""Smallest and largest value of a flag, and their description."""

_NOT_A_NUMBER = re.compile(
    r"Error parsing (?P<flag>--[\w-]+): "
    r"(?:no type matching \{None\}\||invalid literal for |could not convert string to )"
    r"(?P<type>INT|FLOAT|int\(\)|float)[^'\"]*(?P<value>'[^']*'|\"[^\"]*\")\]?\.?"
)
"""Messages of tyro for a value that is not a number."""

_BAD_INPUT = 2
_INTERRUPTED = 130
_OUTPUT_CLOSED = 141


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
        with optional_import():
            return _dispatch(arguments)
    except KeyboardInterrupt:
        print("\njaxslam: interrupted", file=sys.stderr)
        return _INTERRUPTED
    except BrokenPipeError:  # the reader has stopped early, as `head` does: this is not an error
        # At exit, Python would flush the rest of the buffer and report the same error.
        with contextlib.suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _OUTPUT_CLOSED
    except OSError as error:
        where = f"{error.filename}: " if error.filename is not None else ""
        return _report(f"{where}{error.strerror or error}")
    except (ValueError, MissingExtraError) as error:
        return _report(str(error))
    except OverflowError as error:
        return _report(f"a setting, or a number in a file, is too large or too small: {error}")
    except RecursionError:
        return _report("a file is nested too deeply to be read")


def _dispatch(arguments: list[str]) -> int:
    if arguments in (["--version"], ["-V"]):
        import jaxslam

        print(f"jaxslam {jaxslam.__version__}")
        return 0
    if not arguments or arguments[0] in ("--help", "-h"):
        print(_overview())
        return 0
    try:
        command = parse(arguments)
    except SystemExit:  # the help was requested and printed
        return 0
    sys.modules[type(command).__module__].execute(command, arguments)
    return 0


def _overview() -> str:
    """Return the help of `jaxslam`. It needs no command module, so it appears at once."""
    lines = ["usage: jaxslam COMMAND [flags]", ""]
    lines += ["Grid-based particle-filter SLAM for 2D lidar: from a log to a map.", "", "commands:"]
    for name, text in COMMANDS.items():
        lines.append(textwrap.fill(text, 80, initial_indent=f"  {name:<14}", subsequent_indent=" " * 16))
    return "\n".join([*lines, "", "`jaxslam COMMAND --help` lists the flags of a command."])


def parse(arguments: Sequence[str]) -> object:
    """Return the requested command, an instance of a class whose module defines `execute`.

    Raises:
        ValueError: the arguments are wrong; the message is one line.
        SystemExit: the help was requested and printed.
    """
    if list(arguments[:2]) == ["study", "report"]:
        arguments = ["study-report", *arguments[2:]]
    name, *flags = arguments
    check_names("no command is called", COMMANDS, name)
    for before, word in itertools.pairwise(arguments):
        flag, equals, value = word.partition("=") if word.startswith("--") else (before, "=", word)
        if equals and not value:
            raise ValueError(f"{flag} is followed by an empty value: give a value")
    # The modules of the commands import neither JAX nor matplotlib, so that their help appears at once.
    import tyro

    module = importlib.import_module(f"jaxslam.cli.{name.replace('-', '_')}")
    command = getattr(module, name.title().replace("-", ""))
    message = io.StringIO()
    try:
        with contextlib.redirect_stderr(message):
            parsed: Any = tyro.cli(
                command,
                prog=f"jaxslam {name}",
                description=COMMANDS[name],
                args=_one_value_per_set(flags),
            )
    except SystemExit as stop:
        if not stop.code:
            raise
        known = [f"--{field.strip('_').replace('_', '-')}" for field in command.__dataclass_fields__]
        for flag in (word.partition("=")[0].replace("_", "-") for word in flags if word.startswith("--")):
            if flag not in known:
                hint = f"{did_you_mean(flag, known)}`jaxslam {name} --help` lists them"
                raise ValueError(f"{name} has no flag {flag!r}: {hint}") from None
        raise ValueError(_one_line(message.getvalue())) from None
    for flag, (least, most, wanted) in _INTERVALS.items():
        number = getattr(parsed, flag, None)
        if number is not None and not least <= number <= most:
            raise ValueError(f"--{flag} is {number}: give {wanted}")
    return parsed


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
    """Return the sentences before the first inner line of a framed message, without indented help."""
    sentences: list[str] = []
    for line in box.splitlines():
        text = line.strip(" │╭╮╰╯─")
        if not text or text.startswith(("---", "For full helptext")):
            if sentences:
                break
        elif re.match(r"[│ ] {1,8}\S", line):
            sentences.append(text)
    if sentences and (missing := re.match("Missing from (.*):", sentences[0])):
        return f"{missing[1]} needs {' and '.join(sentences[1:])} (see --help)"
    message = " ".join(sentences) or "the command line cannot be understood"
    message = re.sub(r"Missing value for argument '(.*)'. Expected 1 values.", r"\1 needs a value", message)
    return f"{_NOT_A_NUMBER.sub(_give_a_number, message)} (see --help)"


def _give_a_number(match: re.Match[str]) -> str:
    wanted = "a whole number" if match["type"] in ("INT", "int()") else "a number"
    return f"{match['flag']} is {match['value']}: give {wanted}"


def _report(message: str) -> int:
    print(f"jaxslam: error: {' '.join(message.split())}", file=sys.stderr)
    return _BAD_INPUT
