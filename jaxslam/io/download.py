r"""Download of public logs into a cache folder: resumed, verified, converted.

A download is verified against a SHA-256. Where the registry has none, the file is compared with the pinned
commit: the hosting API lists the git blob id of every file of a commit, which is the SHA-1 of `blob <size>\0`
and the content. The SHA-256 of the file is then kept in `checksums.txt` beside it, so later runs verify the
file without the network.
"""

import errno
import functools
import hashlib
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pooch
import requests
from tqdm import tqdm

from jaxslam.io.convert import convert
from jaxslam.io.public_logs import PublicLog, RemoteFile

FILE_URL = "https://raw.githubusercontent.com/{repository}/{commit}/{path}"
TREE_URL = "https://api.github.com/repos/{repository}/git/trees/{commit}?recursive=1"

_CHECKSUMS = "checksums.txt"
_CHUNK = 1 << 16
_TIMEOUT = (10.0, 60.0)  # To connect, and between two pieces, seconds.


class FetchError(ValueError):
    """A failed download. The message is one line: the problem, its place, and the fix."""


class _WrongFileError(FetchError):
    """A commit that does not have the expected file."""


def cache_folder(to: Path | None = None) -> Path:
    """Return the cache folder: `to`, else the environment variable JAXSLAM_CACHE, else the system's cache."""
    if to is None:
        to = Path(os.environ.get("JAXSLAM_CACHE") or pooch.os_cache("jaxslam"))
    return to.expanduser()


def fetch_log(log: PublicLog, folder: Path) -> list[Path]:
    """Download files missing from the cache folder, verify them and convert the log.

    Args:
        log: the log to fetch.
        folder: cache folder; the log gets its own folder in it.

    Returns:
        The converted files, the first log first.

    Raises:
        FetchError: no network, not found, wrong checksum, full disk, or a folder that cannot be written.
        LogError: a file that does not have the expected format.
    """
    home = folder / log.name
    try:
        return convert(log.conversion, log.name, fetch_files(log.files, home / "source"), home)
    except ConnectionError as error:
        raise FetchError(
            f"{error}: check the network, or run the command on another computer and copy its folder "
            f"{log.name} to {home}"
        ) from None
    except OSError as error:
        other = "choose another folder with --to DIR or the environment variable JAXSLAM_CACHE"
        if error.errno == errno.ENOSPC:
            raise FetchError(
                f"{home}: the disk is full: free some space and run the command again, which continues the "
                f"download, or {other}"
            ) from None
        raise FetchError(f"{home}: cannot be written ({error.strerror or error}): {other}") from None


def fetch_files(files: Sequence[RemoteFile], folder: Path) -> list[Path]:
    """Download missing files into a folder, and verify existing ones.

    Returns:
        The paths of the files, in the same order.

    Raises:
        FetchError: as for `fetch_log`.
        OSError: no network, a folder that cannot be written, or a full disk; unfinished downloads are kept.
    """
    folder.mkdir(parents=True, exist_ok=True)
    pooch.get_logger().setLevel("WARNING")
    store = pooch.create(folder, "", registry={}, urls={file.name: _file_url(file) for file in files})
    checksums = folder / _CHECKSUMS
    if checksums.exists():
        store.load_registry(checksums)
    paths = []
    for file in files:
        known = file.sha256 or store.registry.get(file.name)
        store.registry[file.name] = known
        paths.append(Path(store.fetch(file.name, downloader=functools.partial(_download, file, known))))
        if known is None:
            with checksums.open("a", encoding="utf-8") as stream:
                stream.write(f"{file.name} {pooch.file_hash(str(paths[-1]))}\n")
    return paths


def _download(file: RemoteFile, sha256: str | None, url: str, output_file: str, store: Any) -> None:
    """Download a file for pooch, from the first of its commits that has the expected content."""
    commits = (file.commit, *file.other_commits)
    for commit in commits:
        try:
            return _download_from(commit, file, sha256, Path(output_file))
        except _WrongFileError:
            if commit == commits[-1]:
                raise


def _download_from(commit: str, file: RemoteFile, sha256: str | None, output: Path) -> None:
    """Download a file, continuing an unfinished download, and verify it."""
    part = output.with_name(f"{file.name}.{commit[:12]}.part")
    url = _file_url(file, commit)
    if sha256:
        _transfer(url, part, file.size)
        found, expected = pooch.file_hash(str(part)), sha256
    else:
        blobs = _list_blobs(TREE_URL.format(repository=file.repository, commit=commit))
        if file.path not in blobs:
            raise _WrongFileError(f"{file.repository}: no file {file.path} in commit {commit}")
        expected, size = blobs[file.path]
        _transfer(url, part, size)
        found = _blob_id(part)
    if found != expected:
        part.unlink()
        raise _WrongFileError(
            f"{url}: wrong checksum ({found}, expected {expected}): the download was removed; run the "
            "command again, and if the checksum is wrong again, do not use the file"
        )
    os.replace(part, output)


def _file_url(file: RemoteFile, commit: str | None = None) -> str:
    return FILE_URL.format(repository=file.repository, commit=commit or file.commit, path=file.path)


@functools.cache
def _list_blobs(url: str) -> Mapping[str, tuple[str, int]]:
    """Return the blob id and size of the files of a commit, by path."""
    with _get(url) as response:
        entries = response.json()["tree"]
    return {entry["path"]: (entry["sha"], entry["size"]) for entry in entries if entry["type"] == "blob"}


def _transfer(url: str, part: Path, size: int | None) -> None:
    """Continue a download at the end of `part`, or start anew if the server cannot do that."""
    start = part.stat().st_size if part.exists() else 0
    if start and start == size:
        return
    with _get(url, start) as response:
        resumed = response.headers.get("Content-Range", "").startswith(f"bytes {start}-")
        if start and not resumed and response.status_code != requests.codes.ok:
            part.unlink()
            return _transfer(url, part, size)
        done = start if resumed else 0
        name, hidden = part.name.partition(".")[0], not sys.stderr.isatty()
        with (
            part.open("ab" if resumed else "wb") as stream,
            tqdm.wrapattr(
                stream, "write", size, desc=name, initial=done, leave=False, disable=hidden
            ) as progress,
        ):
            for piece in response.iter_content(_CHUNK):
                progress.write(piece)


@contextmanager
def _get(url: str, start: int = 0) -> Iterator[requests.Response]:
    """Request a URL, from byte `start` on; failures are a `FetchError`, or a `ConnectionError`."""
    host = urlsplit(url).netloc
    # Without compression on the way, bytes on the wire are bytes of the file.
    headers = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={start}-"} if start else {})
    answered = False
    try:
        with requests.get(url, headers=headers, stream=True, timeout=_TIMEOUT) as response:
            answered = True
            if not response.ok and response.status_code != requests.codes.requested_range_not_satisfiable:
                status = f"HTTP {response.status_code} {response.reason}".strip()
                if response.status_code == requests.codes.not_found:
                    raise _WrongFileError(f"{url}: {status}: the file is no longer there")
                if response.status_code in (requests.codes.forbidden, requests.codes.too_many_requests):
                    limit = "wait an hour, it limits requests per hour"
                    raise FetchError(f"{host} refuses the request ({status}): {limit}")
                raise FetchError(f"{url}: {status}: run the command again later")
            yield response
    except requests.JSONDecodeError:
        raise FetchError(f"{url}: the answer is not JSON: does the network ask for a login?") from None
    except requests.RequestException as error:
        if answered:
            raise FetchError(
                f"the connection to {host} broke: run the command again, which continues the download"
            ) from None
        cause = "no answer in time" if isinstance(error, requests.Timeout) else "no connection"
        raise ConnectionError(f"cannot reach {host} ({cause})") from None


def _blob_id(path: Path) -> str:
    """Return the git blob id of a file.

    Example:
        An empty file has `e69de29bb2d1d6434b8b29ae775ad8c2e48c5391`.
    """
    content = path.read_bytes()
    return hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()
