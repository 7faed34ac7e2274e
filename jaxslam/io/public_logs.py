"""The public logs that `jaxslam fetch` downloads: their location, use and license."""

from dataclasses import dataclass
from typing import Literal

Conversion = Literal["copy", "corrected", "gfs", "gfs_log", "tinyslam", "wean"]
"""How the files of a log become files that jaxslam reads; see `jaxslam.io.convert`."""


@dataclass(frozen=True)
class RemoteFile:
    """One file of a public GitHub repository at a pinned commit.

    Attributes:
        repository: owner and name, `OWNER/NAME`.
        commit: commit id to download from.
        path: path of the file in the repository.
        name: name of the downloaded file.
        sha256: checksum, if it is known in advance; else the file is compared with the pinned commit.
        size: size in bytes, if it is known in advance.
        other_commits: commits to try next if `commit` does not have the file with this checksum.
    """

    repository: str
    commit: str
    path: str
    name: str
    sha256: str | None = None
    size: int | None = None
    other_commits: tuple[str, ...] = ()


@dataclass(frozen=True)
class PublicLog:
    """A public log.

    Attributes:
        name: name to give to `jaxslam fetch`; the converted files begin with it.
        title: place and sensors.
        use: recommended use of the log, and its limits.
        license: license of the repository, and origin of the data.
        files: files to download, in the order that the conversion expects.
        conversion: conversion of the files.
        command: the jaxslam command to try next.
    """

    name: str
    title: str
    use: str
    license: str
    files: tuple[RemoteFile, ...]
    conversion: Conversion
    command: Literal["run", "localize", "fuse"] = "run"


def _at_commit(repository: str, commit: str, path: str, size: int | None = None) -> RemoteFile:
    return RemoteFile(repository, commit, path, path.rpartition("/")[2], size=size)


def _benchmark_file(
    name: str, size: int | None = None, commit: str = "50506031f42018fc03ea5ca12c5350717726b83e"
) -> RemoteFile:
    return _at_commit("xiaofeng419/SLAM-2D-LIDAR-SCAN", commit, f"DataSet/RawData/{name}", size)


def _corrected(building: str) -> RemoteFile:
    path = f"data/carmen/{building}-corrected.log.gz"
    return _at_commit("acschaefer/ple", "8af88b28759f8a48b1bf33083a85f2013907c41d", path)


def _wean(path: str) -> RemoteFile:
    repository = "Mesywang/Particle-Filter-Localization"
    return _at_commit(repository, "d270c994908dfc9b7dd1fe0a87adcf3ac5f77c53", path)


def _mines(name: str, commit: str, size: int | None = None) -> RemoteFile:
    return _at_commit("simondlevy/BreezySLAM", commit, f"examples/{name}", size)


_NOT_STATED = "not stated by the repository"
_RADISH = "not stated for the data (GPL-3.0 for the code); from Radish, the robotics data set repository"
_BENCHMARK = f"{_NOT_STATED}; from the SLAM benchmark of Kümmerle et al. 2009"
_CORRECTED = (
    "Corrected logs, for mapping speed and for localization on a known map. Their odometry is the result of "
    "another program and not what the wheels measured, so they do not measure a filter's accuracy."
)


def _radish(name: str, title: str, building: str, *relations: RemoteFile) -> PublicLog:
    return PublicLog(name, title, _CORRECTED, _RADISH, (_corrected(building), *relations), "corrected")


PUBLIC_LOGS = {
    log.name: log
    for log in (
        PublicLog(
            "intel",
            "Intel Research Lab, Seattle: SICK lidar, 45 min, raw wheel odometry with a poor heading",
            "Accuracy, measured by the benchmark's relations. The log has only the scans that another "
            "program mapped: about one per half meter or half radian.",
            _BENCHMARK,
            (_benchmark_file("intel.gfs.log", 1742833), _benchmark_file("intel.relations", 265713)),
            "gfs_log",
        ),
        PublicLog(
            "csail",
            "MIT CSAIL, third floor: SICK lidar, 7 min, raw wheel odometry",
            "Comparison with another program's trajectory, which is not ground truth.",
            _RADISH,
            (
                _benchmark_file("csail.corrected.gfs", 3425229, "53dae5f8b897ff7f10cb317b4d7df98158f63fc5"),
                _corrected("csail"),
            ),
            "gfs",
        ),
        PublicLog(
            "mines",
            "Mines ParisTech, two fast drives: Hokuyo URG-04LX, 682 beams over 240°, wheel encoders",
            "A short-range lidar on a fast robot that drives a double loop. It has no reference.",
            "LGPL-3.0 (BreezySLAM); recorded by the authors of tinySLAM",
            (
                _mines("exp1.dat", "f9ae4fc0d0f66b2ed379e17f8707dd94fec2198f", 1741864),
                _mines("exp2.dat", "182f0006af4ccf666fe4953da0ba8a99a24f3c69"),
            ),
            "tinyslam",
        ),
        PublicLog(
            "wean",
            "Wean Hall, CMU: a map and five drives with a SICK lidar, raw wheel odometry",
            "Global localization on a known map. The start poses are not known.",
            f"{_NOT_STATED}; from a robotics course at CMU",
            (_wean("data/map/wean.dat.gz"), *(_wean(f"data/log/robotdata{i}.log.gz") for i in range(1, 6))),
            "wean",
            "localize",
        ),
        PublicLog(
            "husky",
            "Clearpath Husky outdoors, 395 s: wheel odometry, IMU, GPS; no lidar",
            "Fusing wheel odometry and IMU, compared with GPS.",
            "BSD-3-Clause (robot_localization)",
            (
                RemoteFile(
                    "cra-ros-pkg/robot_localization",
                    "1cb9533",
                    "test/test1.bag",
                    "husky.bag",
                    sha256="fd759aa942a3ef549412ff724d15e7280a347a366996a012cf9079329ec28f4a",
                    size=1470835,
                    other_commits=("c662a2f82a5ac7e557996fb4dbf78abf7e6b2ae1",),
                ),
            ),
            "copy",
            "fuse",
        ),
        _radish("aces", "ACES building, Austin: four large nested loops", "aces"),
        _radish(
            "fr079",
            "Freiburg, building 079; with relations",
            "freiburg-079",
            _benchmark_file("fr079.relations"),
        ),
        _radish(
            "mit-killian",
            "MIT, Killian Court and the infinite corridor: very long loops; with relations",
            "infinite-corridor",
            _benchmark_file("mit-killian.relations", 426269),
        ),
        _radish("fr101", "Freiburg, building 101: an office corridor", "freiburg-101"),
        _radish("fr-campus", "Freiburg, campus: outdoors", "freiburg-campus"),
        _radish("acapulco", "Acapulco convention center", "acapulco"),
        _radish("belgioioso", "Belgioioso castle", "belgioioso"),
        _radish("edmonton", "Edmonton convention center", "edmonton"),
        _radish("fhw", "FHW museum, Athens", "fhw"),
        _radish("orebro", "Örebro university", "orebro"),
        _radish("seattle", "University of Washington, Seattle", "seattle"),
    )
}
"""The public logs by name, in the order of the listing."""
