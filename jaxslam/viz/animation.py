"""Write an animated GIF of the growing map, to a file or for a notebook.

Pillow draws the frames as palette images. This takes a few milliseconds per frame, where matplotlib takes
tenths of a second, and the flat colors compress well.
"""

import base64
import io
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from jaxtyping import Array, Float, Shaped, UInt8
from PIL import Image, ImageColor, ImageDraw, ImageFont

from jaxslam.grid.box import Box, known_box
from jaxslam.viz import style
from jaxslam.viz.maps import checked_resolution
from jaxslam.viz.raster import gray_ramp, map_levels, shrink

_NUM_GRAYS = 24
_WHITE, _INK, _PATH, _PARTICLE = range(_NUM_GRAYS, _NUM_GRAYS + 4)
_FOOTER = 26  # pixels under the map for the scale bar and the caption


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
    poses: Float[np.ndarray | Array, "_ 3"]
    particles: Float[np.ndarray | Array, "_ 3"]
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
        source = base64.b64encode(self.gif).decode("ascii")
        return f'<img src="data:image/gif;base64,{source}" alt="animation of {self.num_frames} frames">'


def animate_map(
    path: str | Path,
    frames: Iterable[MapFrame],
    resolution: float | Float[np.ndarray | Array, ""],
    origin: Float[np.ndarray | Array, "2"],
    *,
    max_side: int = 560,
    frame_s: float = 0.08,
    hold_s: float = 2.0,
) -> None:
    """Write an animated GIF. Pillow merges identical consecutive frames into one longer frame.

    Args:
        path: file to write, ending in .gif.
        frames: frames, read one at a time. Only the known part of each map is kept, one byte per cell.
        resolution: side of a cell, meters.
        origin: `[2]` world position of the lower-left corner of cell (0, 0), meters.
        max_side: longer side of the map in the picture, pixels.
        frame_s: duration of each frame, seconds, in multiples of 0.01.
        hold_s: duration of the last frame, seconds.

    Raises:
        ValueError: there are no frames, their maps differ in size, or a value cannot be drawn.
        OSError: the file cannot be written.
    """
    if Path(path).suffix.lower() != ".gif":
        raise ValueError(f"{path} does not end in .gif: animations are written as GIF")
    _write(Path(path), frames, resolution, origin, max_side, frame_s, hold_s)


def animate_inline(
    frames: Iterable[MapFrame],
    resolution: float | Float[np.ndarray | Array, ""],
    origin: Float[np.ndarray | Array, "2"],
    *,
    max_side: int = 560,
    frame_s: float = 0.08,
    hold_s: float = 2.0,
) -> InlineAnimation:
    """Return an animation for a notebook, without a file. The arguments are those of `animate_map`.

    Raises:
        ValueError: there are no frames, their maps differ in size, or a value cannot be drawn.
    """
    stream = io.BytesIO()
    num_frames = _write(stream, frames, resolution, origin, max_side, frame_s, hold_s)
    return InlineAnimation(stream.getvalue(), num_frames)


def _write(
    target: Path | io.BytesIO,
    frames: Iterable[MapFrame],
    resolution: float | Float[np.ndarray | Array, ""],
    origin: Float[np.ndarray | Array, "2"],
    max_side: int,
    frame_s: float,
    hold_s: float,
) -> int:
    """Write the GIF, and return the number of frames."""
    side = checked_resolution(resolution)
    kept = list(_keep(frames))
    if not kept:
        raise ValueError("there are no frames: give at least one MapFrame")
    box = _union([frame.box for frame in kept])
    canvas = _Canvas.fitting(box, side, np.asarray(origin, float), max_side)
    durations = [round(1000 * frame_s)] * (len(kept) - 1) + [round(1000 * hold_s)]
    images = (canvas.draw(frame) for frame in kept)
    first = next(images)
    first.save(target, format="GIF", save_all=True, append_images=images, duration=durations, loop=0)
    return len(kept)


@dataclass(frozen=True)
class _KeptFrame:
    """A frame reduced to its known cells."""

    box: Box
    levels: UInt8[np.ndarray, "h w"]
    poses: Float[np.ndarray, "_ 3"]
    particles: Float[np.ndarray, "_ 3"]
    caption: str


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
    def fitting(cls, box: Box, resolution: float, origin: Float[np.ndarray, "2"], max_side: int) -> "_Canvas":
        rows, columns = box.row_end - box.row, box.column_end - box.column
        scale = max_side / max(rows, columns)
        # Enlarge cells by whole numbers only, because uneven cells look like errors of the map.
        scale = math.floor(scale) if scale >= 1 else scale
        left, _, _, top = box.extent(resolution, origin)
        width, height = max(round(columns * scale), 1), max(round(rows * scale), 1)
        return cls(box, width, height, left, top, scale / resolution)

    def draw(self, frame: _KeptFrame) -> Image.Image:
        cells = np.zeros((self.box.row_end - self.box.row, self.box.column_end - self.box.column))
        cells = cells.astype(np.uint8)
        row, column = frame.box.row - self.box.row, frame.box.column - self.box.column
        height, width = frame.levels.shape
        cells[row : row + height, column : column + width] = frame.levels
        # The rows of a map run upwards, the rows of an image downwards.
        pixels = _gray_index()[_resize(cells, self.height, self.width)[::-1]]
        footer = np.full((_FOOTER, self.width), _WHITE, np.uint8)
        pixels = np.concatenate([pixels, footer])
        image = Image.frombytes("P", (self.width, self.height + _FOOTER), pixels.tobytes())
        image.putpalette(_palette())
        pen = ImageDraw.Draw(image)
        self._draw_poses(pen, frame)
        self._draw_footer(pen, frame.caption)
        return image

    def _draw_poses(self, pen: ImageDraw.ImageDraw, frame: _KeptFrame) -> None:
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
        font = ImageFont.truetype(_font_path(), 12)
        middle = self.height + _FOOTER / 2
        pen.text((right + 6, middle), f"{length:g} m", fill=_INK, font=font, anchor="lm")
        pen.text((self.width - 8, middle), caption, fill=_INK, font=font, anchor="rm")

    def _pixels(self, poses: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        x = (poses[:, 0] - self.left) * self.pixels_per_m
        y = (self.top - poses[:, 1]) * self.pixels_per_m
        return np.stack([x, y], axis=1)


def _keep(frames: Iterable[MapFrame]) -> Iterator[_KeptFrame]:
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
        poses, particles = np.asarray(frame.poses, float), np.asarray(frame.particles, float)
        yield _KeptFrame(
            box=box,
            levels=box.cut(levels).copy(),
            poses=poses[np.isfinite(poses).all(axis=1)],
            particles=particles[np.isfinite(particles).all(axis=1)],
            caption=frame.caption,
        )


def _union(boxes: list[Box]) -> Box:
    return Box(
        row=min(box.row for box in boxes),
        row_end=max(box.row_end for box in boxes),
        column=min(box.column for box in boxes),
        column_end=max(box.column_end for box in boxes),
    )


def _resize(cells: UInt8[np.ndarray, "h w"], height: int, width: int) -> UInt8[np.ndarray, "H W"]:
    if height <= cells.shape[0]:
        return shrink(cells, height, width)
    scale = height // cells.shape[0]
    return cells.repeat(scale, axis=0).repeat(scale, axis=1)


def _gray_index() -> UInt8[np.ndarray, "256"]:
    """Return the palette entry of each level; the grays are evenly spaced."""
    return np.round(gray_ramp() / 255 * (_NUM_GRAYS - 1)).astype(np.uint8)


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


def _font_path() -> str:
    # matplotlib includes this font, so the picture is the same on every machine.
    return str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf")
