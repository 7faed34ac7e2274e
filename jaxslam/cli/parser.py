"""Turning a command line into one of the commands, and tyro's boxes into one line."""

import contextlib
import io
from collections.abc import Sequence

import tyro

from jaxslam.cli.arguments import (
    Command,
    Config,
    Demo,
    Fetch,
    Fuse,
    Info,
    Localize,
    Run,
    Study,
    StudyReport,
    TrainRange,
)


class UsageError(ValueError):
    """A command line that cannot be understood; the message is one line."""


def parse(
    arguments: Sequence[str],
) -> Run | Demo | Localize | Info | Config | Fuse | TrainRange | Study | StudyReport | Fetch:
    """The command that the arguments ask for.

    Raises:
        UsageError: they are wrong.
        SystemExit: help was asked for, and printed.
    """
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            return tyro.cli(
                Command,
                prog="jaxslam",
                description="Grid-based particle-filter SLAM for 2D lidar: from a log to a map.",
                args=_one_value_per_set(_one_word(arguments)),
            )
    except SystemExit as stop:
        if not stop.code:
            raise
        raise UsageError(_one_line(complaint.getvalue())) from None


def _one_word(arguments: Sequence[str]) -> list[str]:
    """`study report` as the command `study-report`, so that both ways of writing it work."""
    return ["study-report", *arguments[2:]] if list(arguments[:2]) == ["study", "report"] else list(arguments)


def _one_value_per_set(arguments: Sequence[str]) -> list[str]:
    """`--set a=1 b=2` as `--set a=1 --set b=2`, so that both ways of writing it work."""
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
    """The first sentences of a framed, wrapped message, up to its first rule, and where to find help."""
    sentences: list[str] = []
    for line in box.splitlines():
        text = line.strip(" │╭╮╰╯─")
        is_frame = line.startswith(("╭", "╰"))
        if not text or line.strip(" │").startswith("──") or text.startswith("For full helptext"):
            if sentences:
                break
        elif not is_frame:
            sentences.append(text)
    return f"{' '.join(sentences) or 'the command line cannot be understood'} (see --help)"
