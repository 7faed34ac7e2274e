"""Occupancy maps in the format of ROS map_server: a gray image and a yaml file beside it.

Arrays `[H, W]` have row 0 at the lowest y, as everywhere in this library; images have row 0 at the top.
Format: http://wiki.ros.org/map_server and nav2_map_server.
"""

import json
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64

from jaxslam.core.names import optional_import
from jaxslam.io.files import one_line_errors

OCCUPIED_THRESHOLD = 0.65
FREE_THRESHOLD = 0.25

_OCCUPIED_PIXEL, _FREE_PIXEL, _UNKNOWN_PIXEL = 0, 254, 205
_MODES = ("trinary", "scale", "raw")
_FINEST, _COARSEST = 1e-4, 1e3  # Smallest and largest plausible side of a cell, meters.
_FARTHEST = 1e8  # Largest plausible distance from the origin of the coordinates, meters.


class MapError(ValueError):
    """An unusable map. The message is one line: the problem, its place, and the fix."""


@dataclass(frozen=True)
class OccupancyMap:
    """A known map.

    Attributes:
        occupied: `[H, W]` true where there is an obstacle.
        free: `[H, W]` true where there is no obstacle; all other cells are unknown.
        resolution: side of a cell, meters.
        origin: `[3]` pose of the outer corner of cell (0, 0) in the world (m, m, rad).
        name: name of the map in error messages, such as the path of its file.
    """

    occupied: Bool[np.ndarray, "H W"]
    free: Bool[np.ndarray, "H W"]
    resolution: float
    origin: Float64[np.ndarray, "3"]
    name: str = "the map"

    @property
    def probability(self) -> Float32[np.ndarray, "H W"]:
        """Return `[H, W]` as `plot_map` and `write_map` expect it: 1 occupied, 0 free, NaN unknown."""
        known = np.where(self.free, np.float32(0.0), np.float32(np.nan))
        return np.where(self.occupied, np.float32(1.0), known)


def write_map(
    path: str | Path,
    occupancy_probability: Float[np.ndarray, "H W"],
    resolution: float,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    occupied_threshold: float = OCCUPIED_THRESHOLD,
    free_threshold: float = FREE_THRESHOLD,
) -> None:
    """Write a map for map_server of ROS 1 and nav2: `NAME.yaml` and `NAME.pgm` beside it.

    Pixels are 0 (occupied), 254 (free) and 205 (unknown).

    Args:
        path: the yaml file.
        occupancy_probability: `[H, W]` in [0, 1], row 0 at the lowest y; NaN is unknown. Above
            `occupied_threshold` a cell is occupied, below `free_threshold` free, else unknown.
        resolution: side of a cell, meters.
        origin: pose of the outer corner of cell (0, 0) in the world (m, m, rad).
        occupied_threshold: also written as `occupied_thresh`.
        free_threshold: also written as `free_thresh`.

    Raises:
        MapError: the suffix is not .yaml or .yml, or a value is out of range.
    """
    path = Path(path)
    if path.suffix not in (".yaml", ".yml"):
        raise MapError(f"{path}: not the name of a yaml file: end it in .yaml")
    _check_numbers(path, resolution, origin, free_threshold, occupied_threshold)
    if occupancy_probability.size == 0:
        raise MapError(f"{path}: the map has no cells: shape {occupancy_probability.shape}")
    with np.errstate(invalid="ignore"):
        outside = (occupancy_probability < 0) | (occupancy_probability > 1)
        occupied = occupancy_probability > occupied_threshold
        free = occupancy_probability < free_threshold
    if outside.any():
        value = occupancy_probability[outside][0]
        raise MapError(f"{path}: probability {value} is outside [0, 1]: convert log-odds l by 1/(1+exp(-l))")
    pixels = np.full(occupancy_probability.shape, _UNKNOWN_PIXEL, dtype=np.uint8)
    pixels[occupied] = _OCCUPIED_PIXEL
    pixels[free] = _FREE_PIXEL
    image = path.with_suffix(".pgm")
    image.write_bytes(f"P5\n{len(pixels[0])} {len(pixels)}\n255\n".encode() + pixels[::-1].tobytes())
    path.write_text(
        f"image: {_yaml_string(image.name)}\n"
        "mode: trinary\n"
        f"resolution: {float(resolution)!r}\n"
        f"origin: [{', '.join(repr(float(value)) for value in origin)}]\n"
        "negate: 0\n"
        f"occupied_thresh: {float(occupied_threshold)!r}\n"
        f"free_thresh: {float(free_threshold)!r}\n",
        encoding="utf-8",
    )


def read_map(path: str | Path) -> OccupancyMap:
    """Read a map of map_server by the rules of nav2's loader.

    Brightness is converted to occupancy (dark is occupied, light with `negate`) and compared with the two
    thresholds. In mode `trinary`, transparency counts as a color channel, and the gray 205 is unknown
    for every `free_thresh`: map savers write 205 for unknown, but nav2's default of 0.25 would make it
    free. In mode `scale`, transparent pixels are unknown. In mode `raw`, pixels from 0 to 100 are the
    occupancy in percent and all others are unknown.

    Args:
        path: the yaml file. `image` is relative to it or absolute, in any format that Pillow opens.

    Returns:
        The map, row 0 at the lowest y.

    Raises:
        MapError: the yaml file or the image is missing or damaged, a key is missing, or a value is out of
            range.
    """
    path = Path(path)
    entries = _read_yaml(path)
    required = ("image", "resolution", "origin", "occupied_thresh", "free_thresh")
    missing = [key for key in required if key not in entries]
    if missing:
        raise MapError(f"{path}: missing keys: {', '.join(missing)}")
    resolution = _number(path, entries, "resolution")
    origin = entries["origin"]
    if not isinstance(origin, list) or len(origin) != 3:
        raise MapError(f"{path}: origin is {origin!r}: expected [x, y, yaw]")
    pose = tuple(_number(path, {"origin": value}, "origin") for value in origin)
    occupied_thresh = _number(path, entries, "occupied_thresh")
    free_thresh = _number(path, entries, "free_thresh")
    _check_numbers(path, resolution, pose, free_thresh, occupied_thresh)
    mode = entries.get("mode", "trinary")
    if mode not in _MODES:
        raise MapError(f"{path}: mode is {mode!r}: expected one of {', '.join(_MODES)}")
    negate = bool(_number(path, entries, "negate", default=0.0))
    if not isinstance(entries["image"], str) or not entries["image"]:
        raise MapError(f"{path}: image is {entries['image']!r}: expected the name of a file")
    image = path.parent / entries["image"]
    if not image.exists():
        raise MapError(f"{path}: its image {image} does not exist: check the line 'image:'")
    shade, alpha = _read_image(image)
    occupancy, known = _occupancy(shade, alpha, mode, negate)
    occupied = known & (occupancy > occupied_thresh)
    free = known & (occupancy < free_thresh)
    return OccupancyMap(occupied[::-1].copy(), free[::-1].copy(), resolution, np.array(pose), str(path))


def _read_image(path: Path) -> tuple[Float64[np.ndarray, "H W"], Float64[np.ndarray, "H W"]]:
    """Read the brightness and the opacity of an image, both in [0, 1], row 0 at the top."""
    with optional_import():
        from PIL import Image, UnidentifiedImageError
    limit = Image.MAX_IMAGE_PIXELS
    try:
        # A file with a byte or more for every pixel, as every large PGM is, cannot be a decompression bomb.
        Image.MAX_IMAGE_PIXELS = limit and max(limit, path.stat().st_size)
        with Image.open(path) as image:
            opaque = "transparency" not in image.info
            if (image.mode == "L" and opaque) or image.mode.startswith("I"):
                # Pillow does not scale 16-bit gray when it converts it.
                shade = np.asarray(image, dtype=np.float64) / (255 if image.mode == "L" else 65535)
                return shade, np.ones_like(shade)
            channels = np.asarray(image.convert("RGBA"), dtype=np.float64) / 255
    except UnidentifiedImageError:
        raise MapError(f"{path}: not an image: expected PGM or PNG") from None
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise MapError(f"{path}: cannot be read, perhaps cut short or damaged: {error}") from None
    finally:
        Image.MAX_IMAGE_PIXELS = limit
    return channels[..., :3].mean(axis=-1), channels[..., 3]


def _occupancy(
    shade: Float64[np.ndarray, "H W"], alpha: Float64[np.ndarray, "H W"], mode: str, negate: bool
) -> tuple[Float64[np.ndarray, "H W"], Bool[np.ndarray, "H W"]]:
    """Return the occupancy in [0, 1] and a mask of the known cells."""
    if mode == "raw":
        percent = np.rint(shade * 255)
        return percent / 100, percent <= 100
    if mode == "scale":
        return shade if negate else 1 - shade, alpha == 1
    known = (np.rint(shade * 255) != _UNKNOWN_PIXEL) | (alpha < 1)
    if (alpha < 1).any():  # Like nav2's loader, average alpha in if the image has it.
        shade = (3 * shade + alpha) / 4
    return shade if negate else 1 - shade, known


def _read_yaml(path: Path) -> Mapping[str, Any]:
    with optional_import():
        from ruamel.yaml import YAML
        from ruamel.yaml.error import YAMLError
    try:
        with one_line_errors(path, MapError):
            entries = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    except UnicodeDecodeError:
        raise MapError(
            f"{path}: not a text file: give the .yaml of the map, not its image or a log"
        ) from None
    except YAMLError as error:
        reason = " ".join(str(error).split())
        raise MapError(f"{path}: not valid yaml: {reason}") from None
    if not isinstance(entries, Mapping):
        raise MapError(f"{path}: not a map: expected 'image:', 'resolution:', 'origin:' and so on")
    return entries


def _number(path: Path, entries: Mapping[str, Any], key: str, default: float | None = None) -> float:
    value = entries.get(key, default)
    # An integer can be too large for a float.
    if not isinstance(value, int | float) or not abs(value) <= sys.float_info.max:
        raise MapError(f"{path}: {key} is {repr(value)[:40]}: expected a number")
    return float(value)


def _check_numbers(
    path: Path, resolution: float, origin: tuple[float, ...], free: float, occupied: float
) -> None:
    if not _FINEST <= resolution <= _COARSEST:
        raise MapError(
            f"{path}: resolution is {resolution!r}: expected {_FINEST:g} to {_COARSEST:g} meters per cell"
        )
    if len(origin) != 3 or not np.isfinite(origin).all() or np.abs(origin).max() > _FARTHEST:
        raise MapError(f"{path}: origin is {origin!r}: expected x and y up to {_FARTHEST:g} m, and yaw")
    if not 0 <= free < occupied <= 1:
        raise MapError(
            f"{path}: free_thresh {free:g} and occupied_thresh {occupied:g}: expected "
            "0 ≤ free_thresh < occupied_thresh ≤ 1"
        )


def _yaml_string(text: str) -> str:
    """Return a name unquoted if YAML reads it back as the same string, else in double quotes."""
    return text if re.fullmatch(r"[A-Za-z][\w.-]*\.\w+", text, re.ASCII) else json.dumps(text)
