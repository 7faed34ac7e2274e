"""Write an animated GIF of the growing map, to a file or for a notebook.

Pillow draws the frames as palette images. A frame takes a few milliseconds, instead of tenths of a second in
matplotlib, and the flat colors compress well.
"""

import io
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib
import numpy as np
from jaxtyping import Array, Float, Shaped, UInt8
from PIL import Image, ImageColor, ImageDraw, ImageFont

from jaxslam.grid.box import Box, known_box
from jaxslam.viz import style
from jaxslam.viz.maps import Poses, checked_resolution
from jaxslam.viz.notebook import image_html
from jaxslam.viz.raster import gray_ramp, map_levels, shrink

_NUM_GRAYS = 24
_ENTRY_OF_LEVEL = np.round(gray_ramp() / 255 * (_NUM_GRAYS - 1)).astype(np.uint8)
"""Entry of each level in the palette, which begins with the evenly spaced grays."""
_WHITE, _INK, _PATH, _PARTICLE = range(_NUM_GRAYS, _NUM_GRAYS + 4)
_FOOTER = 26  # pixels under the map for the scale bar and the caption
_LAST_FRAME_MS = 2000


@dataclass(frozen=True)
class MapFrame:
    """One frame of an animation.

    Attributes:
        occupancy: `[H, W]` probabilities, int8 log-odds or uint8 levels, see `map_levels`. All frames have
            the same cells.
        poses: `[M, 3]` trajectory so far (m, m, rad). The robot is drawn at the last pose.
        particles: `[N, 3]` particle poses.
        caption: text under the map, such as the time.
    """

    occupancy: Shaped[np.ndarray | Array, "*shape"]
    poses: Poses
    particles: Poses
    caption: str = ""


@dataclass(frozen=True)
class InlineAnimation:
    """An animation that a notebook plays if it is the last value of a cell.

    Attributes:
        gif: bytes of the GIF file.
        num_frames: number of frames.
    """

    gif: bytes
    num_frames: int

    def __repr__(self) -> str:
        return f"InlineAnimation({self.num_frames} frames, {len(self.gif) / 1e3:.0f} kB)"

    def _repr_html_(self) -> str:
        return image_html(self.gif, "gif", f"animation of {self.num_frames} frames")


def animate_map(
    path: str | Path | io.BytesIO,
    frames: Iterable[MapFrame],
    resolution: float | Float[np.ndarray | Array, ""],
    origin: Float[np.ndarray | Array, "2"],
    *,
    max_side: int = 560,
    frame_s: float = 0.08,
) -> int:
    """Write an animated GIF, whose last frame stays for 2 s, and return the number of frames.

    Pillow merges identical consecutive frames into one longer frame.

    Args:
        path: file to write, ending in .gif, or a stream of bytes.
        frames: frames, read one at a time. Only the known part of each map is kept, one byte per cell.
        resolution: side of a cell, meters.
        origin: `[2]` world position of the lower-left corner of cell (0, 0), meters.
        max_side: longer side of the map in the picture, pixels.
        frame_s: duration of each frame, seconds, in multiples of 0.01.

    Raises:
        ValueError: there are no frames, their maps differ in size, or a value cannot be drawn.
        OSError: the file cannot be written.
    """
    if isinstance(path, str | Path) and Path(path).suffix.lower() != ".gif":
        raise ValueError(f"{path} does not end in .gif: animations are written as GIF")
    side = checked_resolution(resolution)
    kept = list(_keep(frames))
    if not kept:
        raise ValueError("there are no frames: give at least one MapFrame")
    canvas = _Canvas.fitting([box for box, _ in kept], side, np.asarray(origin, float), max_side)
    durations = [round(1000 * frame_s)] * (len(kept) - 1) + [_LAST_FRAME_MS]
    images = (canvas.draw(box, frame) for box, frame in kept)
    first = next(images)
    first.save(path, format="GIF", save_all=True, append_images=images, duration=durations, loop=0)
    return len(kept)


def animate_inline(
    frames: Iterable[MapFrame],
    resolution: float | Float[np.ndarray | Array, ""],
    origin: Float[np.ndarray | Array, "2"],
    *,
    max_side: int = 560,
    frame_s: float = 0.08,
) -> InlineAnimation:
    """Return an animation for a notebook, without a file. The arguments are those of `animate_map`.

    Raises:
        ValueError: there are no frames, their maps differ in size, or a value cannot be drawn.
    """
    stream = io.BytesIO()
    num_frames = animate_map(stream, frames, resolution, origin, max_side=max_side, frame_s=frame_s)
    return InlineAnimation(stream.getvalue(), num_frames)


@dataclass(frozen=True)
class _Canvas:
    """The placement of the world in the picture."""

    box: Box
    width: int
    height: int
    left: float
    top: float
    pixels_per_m: float

    @classmethod
    def fitting(
        cls, boxes: Sequence[Box], resolution: float, origin: Float[np.ndarray, "2"], max_side: int
    ) -> "_Canvas":
        """Return the canvas on which the longer side of all boxes together has `max_side` pixels."""
        box = Box(
            row=min(box.row for box in boxes),
            row_end=max(box.row_end for box in boxes),
            column=min(box.column for box in boxes),
            column_end=max(box.column_end for box in boxes),
        )
        rows, columns = box.row_end - box.row, box.column_end - box.column
        scale = max_side / max(rows, columns)
        # Enlarge cells by whole numbers only, because uneven cells look like errors of the map.
        scale = math.floor(scale) if scale >= 1 else scale
        left, _, _, top = box.extent(resolution, origin)
        width, height = max(round(columns * scale), 1), max(round(rows * scale), 1)
        return cls(box, width, height, left, top, scale / resolution)

    def draw(self, box: Box, frame: MapFrame) -> Image.Image:
        """Draw a frame whose map is cut to its box."""
        shape = (self.box.row_end - self.box.row, self.box.column_end - self.box.column)
        cells = np.zeros(shape, np.uint8)
        row, column = box.row - self.box.row, box.column - self.box.column
        height, width = frame.occupancy.shape
        cells[row : row + height, column : column + width] = frame.occupancy
        # The rows of a map run upwards, the rows of an image downwards.
        pixels = _ENTRY_OF_LEVEL[_resize(cells, self.height, self.width)[::-1]]
        pixels = np.pad(pixels, [(0, _FOOTER), (0, 0)], constant_values=_WHITE)
        image = Image.frombytes("P", (self.width, self.height + _FOOTER), pixels.tobytes())
        image.putpalette(_palette())
        pen = ImageDraw.Draw(image)
        self._draw_poses(pen, frame)
        self._draw_footer(pen, frame.caption)
        return image

    def _draw_poses(self, pen: ImageDraw.ImageDraw, frame: MapFrame) -> None:
        path = self._pixels(frame.poses)
        if len(path) > 1:
            pen.line([tuple(point) for point in path], fill=_PATH, width=2, joint="curve")
        if len(path):
            (x, y), theta = path[-1], frame.poses[-1, 2]
            pen.ellipse((x - 5, y - 5, x + 5, y + 5), fill=_WHITE, outline=_PATH, width=2)
            tip = (x + 9 * np.cos(theta), y - 9 * np.sin(theta))
            pen.line([(x, y), tip], fill=_PATH, width=2)
        # Draw particles last, because the robot would hide a converged cloud.
        for x, y in self._pixels(frame.particles):
            pen.ellipse((x - 1.5, y - 1.5, x + 1.5, y + 1.5), fill=_PARTICLE)

    def _draw_footer(self, pen: ImageDraw.ImageDraw, caption: str) -> None:
        length = _round_length(0.25 * self.width / self.pixels_per_m)
        baseline, right = self.height + 17, 8 + length * self.pixels_per_m
        pen.line([(8, baseline), (right, baseline)], fill=_INK, width=2)
        # matplotlib includes this font, so the picture is the same on every machine.
        font = ImageFont.truetype(Path(matplotlib.get_data_path()) / "fonts/ttf/DejaVuSans.ttf", 12)
        middle = self.height + _FOOTER / 2
        pen.text((right + 6, middle), f"{length:g} m", fill=_INK, font=font, anchor="lm")
        pen.text((self.width - 8, middle), caption, fill=_INK, font=font, anchor="rm")

    def _pixels(self, poses: Poses) -> Float[np.ndarray, "_ 2"]:
        x, y = np.asarray(poses)[:, :2].T
        return self.pixels_per_m * np.stack([x - self.left, self.top - y], axis=1)


def _keep(frames: Iterable[MapFrame]) -> Iterator[tuple[Box, MapFrame]]:
    """Yield the known part of each frame's map, as levels, without poses that are not finite."""
    shape = None
    for index, frame in enumerate(frames):
        levels = map_levels(frame.occupancy)
        shape = levels.shape if shape is None else shape
        if levels.shape != shape:
            raise ValueError(
                f"frame {index} has a map of shape {levels.shape}, but frame 0 {shape}: give all frames "
                "maps on the same cells"
            )
        box = known_box(levels, margin=2)
        yield (
            box,
            replace(
                frame,
                occupancy=box.cut(levels).copy(),
                poses=_finite(frame.poses),
                particles=_finite(frame.particles),
            ),
        )


def _finite(poses: Poses) -> Poses:
    array = np.asarray(poses, float)
    return array[np.isfinite(array).all(axis=1)]


def _resize(cells: UInt8[np.ndarray, "h w"], height: int, width: int) -> UInt8[np.ndarray, "H W"]:
    if height <= cells.shape[0]:
        return shrink(cells, height, width)
    scale = height // cells.shape[0]
    return cells.repeat(scale, axis=0).repeat(scale, axis=1)


def _palette() -> list[int]:
    grays = np.round(np.linspace(0, 255, _NUM_GRAYS)).astype(int)
    colors = [(int(gray),) * 3 for gray in grays]
    for name in ("#FFFFFF", "#222222", style.ESTIMATE, style.PARTICLES):
        colors.append(ImageColor.getrgb(name)[:3])
    return [value for color in colors for value in color]


def _round_length(target: float) -> float:
    """Return the largest of 1, 2, 5 × 10^k that is at most `target`."""
    decade = 10.0 ** math.floor(math.log10(target))
    return max(step * decade for step in (1, 2, 5) if step * decade <= target * (1 + 1e-9))
