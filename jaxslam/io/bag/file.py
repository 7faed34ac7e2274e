"""Access to the messages of ROS 1 and ROS 2 bags. The only file that imports rosbags.

Messages are decoded by the standard definitions, not by the definitions in the bag: the six types used
here never changed, and a bag with other, undecodable types stays readable.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from jaxslam.core.names import optional_import
from jaxslam.io.bag.topics import TRANSFORMS
from jaxslam.io.files import read_head
from jaxslam.io.log import LogError

ROS1_MAGIC = b"#ROSBAG"
MCAP_MAGIC = b"\x89MCAP0\r\n"
SQLITE_MAGIC = b"SQLite format 3"


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
            LogError: the bag is missing, cut or damaged.
        """
        with optional_import():
            from rosbags.rosbag1 import Reader as Reader1
            from rosbags.rosbag2 import Reader as Reader2
            from rosbags.typesys import Stores, get_types_from_msg, get_typestore
        self.path = path
        self._is_ros1 = _check_path(path)
        self._typestore = get_typestore(Stores.ROS1_NOETIC if self._is_ros1 else Stores.ROS2_HUMBLE)
        if TRANSFORMS not in self._typestore.types:  # As in rosbags' definitions of ROS 1.
            definition = "geometry_msgs/TransformStamped[] transforms"
            self._typestore.register(get_types_from_msg(definition, TRANSFORMS))
        try:
            self._reader = Reader1(path) if self._is_ros1 else Reader2(path)
            self._reader.open()
        except Exception as error:  # rosbags and its decompressors raise errors of many types.
            raise self._damaged(error) from None
        self._connections = list(self._reader.connections)
        self.topics: dict[str, tuple[str, int]] = {}
        for connection in sorted(self._connections, key=lambda connection: connection.topic):
            _, count = self.topics.get(connection.topic, ("", 0))
            # Several nodes may publish one topic over several connections.
            self.topics[connection.topic] = (connection.msgtype, count + connection.msgcount)

    def __enter__(self) -> "BagFile":
        return self

    def __exit__(self, *exception: object) -> None:
        self._reader.close()

    def messages(self, topic: str) -> Iterator[tuple[Any, float]]:
        """Yield the decoded messages of a topic, each with its time of receipt in seconds.

        Raises:
            LogError: the bag is damaged, or the topic's type differs from the standard definition.
        """
        kind = self.topics[topic][0]
        connections = [
            connection
            for connection in self._connections
            if connection.topic == topic and connection.msgtype == kind
        ]
        if self._is_ros1:
            decode, standard = self._typestore.deserialize_ros1, self._typestore.generate_msgdef(kind)[1]
        else:
            decode, standard = self._typestore.deserialize_cdr, self._typestore.hash_rihs01(kind)
        if any(connection.digest not in (None, "", "*", standard) for connection in connections):
            raise LogError(
                f"{self.path}: topic '{topic}' has another definition of {kind} than ROS: "
                "convert the bag, or choose another topic"
            )
        try:
            for _, received, data in self._reader.messages(connections=connections):
                yield decode(data, kind), received * 1e-9
        except Exception as error:  # As for opening.
            raise self._damaged(error) from None

    def _damaged(self, error: Exception) -> LogError:
        reason = " ".join(str(error).split()) or type(error).__name__
        repair = "rosbag reindex" if self._is_ros1 else "mcap recover (or ros2 bag reindex)"
        return LogError(
            f"{self.path}: the bag is cut short or damaged ({reason[:200]}): "
            f"copy it again or repair it with {repair}"
        )


def _check_path(path: Path) -> bool:
    """Return whether the path is a ROS 1 bag; raise `LogError` if it is not a bag."""
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            raise LogError(
                f"{path}: the folder has no metadata.yaml, so it is not a ROS 2 bag: give the "
                ".mcap or .db3 file itself, or make metadata.yaml with 'ros2 bag reindex'"
            )
        return False
    head = read_head(path)
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
