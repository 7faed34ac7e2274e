"""`jaxslam fetch [NAME]`."""

import itertools
import shlex
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional

from jaxslam.cli import options
from jaxslam.core.names import check_names

if TYPE_CHECKING:
    from jaxslam.io.public_logs import PublicLog

_OPTIONS = {".relations": "--relations", ".reference.tum": "--reference", ".yaml": "--map"}


@dataclass(frozen=True)
class Fetch:
    """Flags of `jaxslam fetch`."""

    name: Annotated[str | None, Positional, options.optional("NAME", "list the logs")] = None
    """Log to download."""
    to: Annotated[Path | None, options.optional("DIR", "$JAXSLAM_CACHE, else the system's cache")] = None
    """Folder for the downloaded and converted files. An interrupted download continues where it stopped."""


def execute(command: Fetch, arguments: list[str]) -> None:
    """Fetch a log and print the paths of its files and the next command; or list the logs."""
    from jaxslam.io.public_logs import PUBLIC_LOGS

    if command.name is None:
        print("\n".join(_listing()))
        return
    check_names("no public log is called", PUBLIC_LOGS, command.name)

    from jaxslam.io.download import cache_folder, fetch_log

    log = PUBLIC_LOGS[command.name]
    written = fetch_log(log, cache_folder(command.to).resolve())
    for path in written:
        print(path)
    print(f"next: {next_command(log, written)}")


def next_command(log: "PublicLog", written: Sequence[Path]) -> str:
    """Return the jaxslam command to try next on the files of a log."""
    words = ["jaxslam", log.command, str(written[0])]
    for suffix, option in _OPTIONS.items():
        words += [word for path in written if path.name.endswith(suffix) for word in (option, str(path))]
    words += {"run": [], "localize": ["--global"], "fuse": ["--gps"]}[log.command]
    return shlex.join(words)


def _listing() -> Iterator[str]:
    """Yield one line per log; logs of the same use and license share the explanation below them."""
    from jaxslam.io.public_logs import PUBLIC_LOGS

    for (use, license_note), logs in itertools.groupby(
        PUBLIC_LOGS.values(), key=lambda log: (log.use, log.license)
    ):
        for log in logs:
            yield f"{log.name:<12} {_size(log):<10} {log.title}"
        for text in (use, f"License: {license_note}."):
            yield textwrap.indent(textwrap.fill(text, width=84, break_on_hyphens=False), " " * 24)
    yield "`jaxslam fetch NAME` downloads a log; a size marked by ? or > is known only then."


def _size(log: "PublicLog") -> str:
    sizes = [file.size for file in log.files]
    known = sum(size or 0 for size in sizes) / 1e6
    return f"{known:.1f} MB" if None not in sizes else f"> {known:.1f} MB" if known else "?"
