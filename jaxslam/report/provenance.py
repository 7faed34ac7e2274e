"""Where a result came from: versions, checksums, memory."""

import hashlib
import importlib.metadata
import platform
import sys
from pathlib import Path

_PACKAGES = ("jaxslam", "jax", "jaxlib", "equinox", "numpy")
_BLOCK = 1 << 20


def versions() -> dict[str, str]:
    """Versions of this package, of what it computes with, of Python and of the platform."""
    found = {name: importlib.metadata.version(name) for name in _PACKAGES}
    return {**found, "python": platform.python_version(), "platform": platform.platform()}


def file_sha256(path: Path) -> str:
    """Checksum of a file; of a folder, that of the names and contents of its files in order.

    Raises:
        OSError: it cannot be read.
    """
    digest = hashlib.sha256()
    for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
        if path.is_dir():
            digest.update(file.relative_to(path).as_posix().encode() + b"\0")
        if file.is_file():
            with file.open("rb") as stream:
                while block := stream.read(_BLOCK):
                    digest.update(block)
    return digest.hexdigest()


def peak_rss_mb() -> float | None:
    """Largest resident memory of this process so far, MB (10⁶ bytes); None where it cannot be known."""
    status = Path("/proc/self/status")
    if status.exists():
        # `getrusage` would count what the parent process used before it started this one.
        for line in status.read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
    try:
        import resource
    except ModuleNotFoundError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1 if sys.platform == "darwin" else 1024) / 1e6
