"""Record the provenance of a result: versions, checksums, memory."""

import hashlib
import importlib.metadata
import platform
import sys
from pathlib import Path

_PACKAGES = ("jaxslam", "jax", "jaxlib", "equinox", "numpy")


def versions() -> dict[str, str]:
    """Return the versions of this package, of its main dependencies, of Python and of the platform."""
    packages = {name: importlib.metadata.version(name) for name in _PACKAGES}
    return {**packages, "python": platform.python_version(), "platform": platform.platform()}


def file_sha256(path: Path) -> str:
    """Return the SHA-256 checksum of a file, or of the sorted names and contents of the files of a folder.

    Raises:
        OSError: the file or the folder cannot be read.
    """
    digest = hashlib.sha256()
    for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
        if path.is_dir():
            digest.update(file.relative_to(path).as_posix().encode() + b"\0")
        if file.is_file():
            with file.open("rb") as stream:
                hashlib.file_digest(stream, lambda: digest)
    return digest.hexdigest()


def peak_rss_mb() -> float | None:
    """Return the peak resident memory of this process, MB (10⁶ bytes); None if the system hides it."""
    status = Path("/proc/self/status")
    if status.exists():
        # `getrusage` would include memory that the parent process used before it started this one.
        for line in status.read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
    try:
        import resource
    except ModuleNotFoundError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1 if sys.platform == "darwin" else 1024) / 1e6
