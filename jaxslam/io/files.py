"""Errors of files that cannot be read, and the first bytes of a file."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from jaxslam.io.log import LogError

GZIP_MAGIC = b"\x1f\x8b"


@contextmanager
def one_line_errors(path: Path, error: type[ValueError] = LogError) -> Iterator[None]:
    """Replace the errors of a missing or unreadable file by an `error` of one line."""
    try:
        yield
    except FileNotFoundError:
        raise error(f"{path}: no such file") from None
    except OSError as cause:
        raise error(f"{path}: cannot be read: {cause.strerror or cause}") from None


def read_head(path: Path) -> bytes:
    """Return the first 16 bytes of a log, which identify its kind.

    Raises:
        LogError: the file is missing or cannot be read.
    """
    with one_line_errors(path), path.open("rb") as stream:
        return stream.read(16)
