"""Access to the messages of ROS 1 and ROS 2 bags. The only file that imports rosbags.

Messages are decoded by the standard definitions, not by the definitions in the bag: the six types used
here never changed, and a bag with other, undecodable types stays readable.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from jaxslam.io.bag.topics import TRANSFORMS
from jaxslam.io.log import LogError

ROS1_MAGIC = b"#ROSBAG"
MCAP_MAGIC = b"\x89MCAP0\r\n"
SQLITE_MAGIC = b"SQLite format 3"

# Errors from decoding damaged bytes, besides the error types of rosbags and its decompressors.
_DAMAGE = (
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    AssertionError,
    ArithmeticError,
    EOFError,
    OSError,
    MemoryError,
    RuntimeError,
    struct.error,
)


class BagMessage(NamedTuple):
    """A decoded message and its time of receipt, seconds."""

    content: Any
    received: float


class BagFile:
    """An open bag: its topics and, decoded, its messages.

    Attributes:
        path: the bag.
        topics: message type and number of messages by topic, sorted by name.
    """

    def __init__(self, path: Path) -> None:
        """Open a bag.

        Args:
            path: ROS 1 `.bag`, ROS 2 `.mcap` or `.db3`, or the folder of a ROS 2 bag.

        Raises:
            LogError: rosbags is not installed, or the bag is missing, cut or damaged.
        """
        try:
            from rosbags.rosbag1 import Reader as Reader1
            from rosbags.rosbag2 import Reader as Reader2
            from rosbags.typesys import Stores, get_types_from_msg, get_typestore
        except ImportError:
            raise LogError(
                f"{path}: reading bags needs the rosbags package: pip install 'jaxslam[cli]'"
            ) from None
        self.path = path
        self._errors = _DAMAGE + _package_errors()
        self._is_ros1 = _check_path(path)
        self._typestore = get_typestore(Stores.ROS1_NOETIC if self._is_ros1 else Stores.ROS2_HUMBLE)
        if TRANSFORMS not in self._typestore.types:  # As in rosbags' definitions of ROS 1.
            definition = "geometry_msgs/TransformStamped[] transforms"
            self._typestore.register(get_types_from_msg(definition, TRANSFORMS))
        try:
            self._reader = Reader1(path) if self._is_ros1 else Reader2(path)
            self._reader.open()
        except self._errors as error:
            raise self._damaged(error) from None
        self._connections = list(self._reader.connections)
        self.topics = self._count_topics()

    def __enter__(self) -> "BagFile":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._reader.close()

    def _count_topics(self) -> dict[str, tuple[str, int]]:
        topics: dict[str, tuple[str, int]] = {}
        for connection in sorted(self._connections, key=lambda connection: connection.topic):
            _, count = topics.get(connection.topic, ("", 0))
            # Several nodes may publish one topic over several connections.
            topics[connection.topic] = (connection.msgtype, count + connection.msgcount)
        return topics

    def messages(self, topic: str) -> Iterator[BagMessage]:
        """Yield the decoded messages of a topic in the order of receipt.

        Raises:
            LogError: the bag is damaged, or the topic's type differs from the standard definition.
        """
        kind = self.topics[topic][0]
        connections = [
            connection
            for connection in self._connections
            if connection.topic == topic and connection.msgtype == kind
        ]
        for connection in connections:
            self._check_definition(connection.topic, kind, connection.digest)
        decode = self._typestore.deserialize_ros1 if self._is_ros1 else self._typestore.deserialize_cdr
        source = self._reader.messages(connections=connections)
        while True:
            try:
                _, received, data = next(source)
                content = decode(data, kind)
            except StopIteration:
                return
            except self._errors as error:
                raise self._damaged(error) from None
            yield BagMessage(content, received * 1e-9)

    def _check_definition(self, topic: str, kind: str, digest: str) -> None:
        standard = (
            self._typestore.generate_msgdef(kind)[1] if self._is_ros1 else self._typestore.hash_rihs01(kind)
        )
        if digest and digest not in ("*", standard):
            raise LogError(
                f"{self.path}: topic '{topic}' has another definition of {kind} than ROS: "
                "convert the bag, or choose another topic"
            )

    def _damaged(self, error: BaseException) -> LogError:
        reason = " ".join(str(error).split()) or type(error).__name__
        repair = "rosbag reindex" if self._is_ros1 else "mcap recover (or ros2 bag reindex)"
        return LogError(
            f"{self.path}: the bag is cut short or damaged ({reason[:200]}): "
            f"copy it again or repair it with {repair}"
        )


def _check_path(path: Path) -> bool:
    """Return whether the path is a ROS 1 bag; raise `LogError` if it is not a bag."""
    if not path.exists():
        raise LogError(f"{path}: no such file")
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            raise LogError(
                f"{path}: the folder has no metadata.yaml, so it is not a ROS 2 bag: give the "
                ".mcap or .db3 file itself, or make metadata.yaml with 'ros2 bag reindex'"
            )
        return False
    try:
        with path.open("rb") as stream:
            head = stream.read(16)
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from None
    if not head:
        raise LogError(f"{path}: is empty")
    if head.startswith(ROS1_MAGIC):
        return True
    for magic, suffix in ((MCAP_MAGIC, ".mcap"), (SQLITE_MAGIC, ".db3")):
        if head.startswith(magic):
            if path.suffix != suffix:
                raise LogError(f"{path}: is a ROS 2 bag of kind {suffix}: rename it to *{suffix}")
            return False
    raise LogError(f"{path}: is not a bag: expected a ROS 1 .bag, a ROS 2 .mcap or .db3, or a bag folder")


def _package_errors() -> tuple[type[BaseException], ...]:
    """Return the error types of rosbags and of the packages it uses to decompress and query."""
    import importlib

    names = (
        ("rosbags.rosbag1", "ReaderError"),
        ("rosbags.rosbag2", "ReaderError"),
        ("rosbags.serde", "SerdeError"),
        ("rosbags.typesys", "TypesysError"),
        ("compression.zstd", "ZstdError"),
        ("backports.zstd", "ZstdError"),
        ("zstandard", "ZstdError"),
        ("apsw", "Error"),
        ("sqlite3", "Error"),
    )
    errors = []
    for module, name in names:
        try:
            errors.append(getattr(importlib.import_module(module), name))
        except (ImportError, AttributeError):  # Which modules exist depends on the installed versions.
            continue
    return tuple(errors)
