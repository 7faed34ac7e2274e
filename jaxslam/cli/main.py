"""The entry point: parse, dispatch, and one clear line for everything that went wrong."""

import importlib
import importlib.metadata
import os
import re
import sys
from collections.abc import Sequence
from contextlib import suppress

_EXTRAS = {
    "cli": ("tyro", "matplotlib", "PIL", "rosbags", "ruamel", "tqdm", "pooch"),
    "train": ("lineax", "optax", "optimistix"),
    "vision": ("skimage",),
    "study": ("optuna", "sqlalchemy", "cmaes", "sklearn"),
    "cluster": ("dask", "distributed"),
}
"""What the commands need beyond the library itself, by the names under which it is imported."""

_BAD_INPUT = 2
_INTERRUPTED = 130
_UNREAD = 141


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the `jaxslam` command.

    Args:
        arguments: without the program's name; None takes those of the process.

    Returns:
        The exit code: 0, 2 for a wrong command line or data that cannot be used, 130 if interrupted, 141 if
        nobody reads the output any more.
    """
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    # Pipes and old consoles may not have the units' characters: better a mark than no output.
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    try:
        return _dispatch(arguments)
    except KeyboardInterrupt:
        print("\njaxslam: interrupted", file=sys.stderr)
        return _INTERRUPTED
    except BrokenPipeError:
        return unread()
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        extra = next((name for name, modules in _EXTRAS.items() if missing in modules), None)
        if extra is None:
            raise
        return _complain(f"{missing} is not installed: pip install 'jaxslam[{extra}]'")
    except OSError as error:
        where = f"{error.filename}: " if error.filename is not None else ""
        return _complain(f"{where}{error.strerror or error}")
    except ValueError as error:
        return _complain(str(error))
    except OverflowError as error:
        return _complain(f"a setting, or a number in a file, is too large or too small: {error}")
    except RecursionError:
        return _complain("a file is nested too deeply to be read")


def _dispatch(arguments: Sequence[str]) -> int:
    if list(arguments) in (["--version"], ["-V"]):
        print(f"jaxslam {importlib.metadata.version('jaxslam')}")
        return 0
    from jaxslam.cli.parser import parse

    try:
        command = parse(arguments or ["--help"])
    except SystemExit:  # help was asked for and printed
        return 0
    # Each command is a module of its own: `--help` and `info` do not wait for JAX.
    name = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", type(command).__name__).lower()
    module = importlib.import_module(f"jaxslam.cli.{name}")
    module.execute(command, list(arguments))
    return 0


def unread() -> int:
    """For a command whose output is cut off, as by `head`: that is no error to complain of.

    Returns:
        The exit code of one that the system ends for it.
    """
    # What is still in the buffer would be tried once more at the end, and complained of.
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return _UNREAD


def _complain(message: str) -> int:
    print(f"jaxslam: error: {' '.join(message.split())}", file=sys.stderr)
    return _BAD_INPUT
