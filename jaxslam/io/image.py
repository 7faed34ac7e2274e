"""Gray images for maps: PGM read and written here, other formats read with Pillow."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, UInt8


class MapError(ValueError):
    """A map that cannot be used. The message is one line: what is wrong, where, what to do."""


class GrayImage(NamedTuple):
    """Brightness `[H, W]` in [0, 1], row 0 at the top; `alpha` `[H, W]` likewise, 1 is opaque."""

    shade: Float64[np.ndarray, "H W"]
    alpha: Float64[np.ndarray, "H W"]


def write_pgm(path: Path, pixels: UInt8[np.ndarray, "H W"]) -> None:
    """Writes a binary PGM (P5, 8 bit); row 0 of `[H, W]` is the top row."""
    height, width = pixels.shape
    path.write_bytes(b"P5\n%d %d\n255\n" % (width, height) + pixels.tobytes())


def read_image(path: Path) -> GrayImage:
    """Reads a PGM (P2, P5, 8 or 16 bit) or, with Pillow, any image it can open.

    Raises:
        MapError: missing, unreadable, cut or damaged; or Pillow is needed and not installed.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise MapError(f"{path}: no such image: check 'image:' in the map's yaml") from None
    except OSError as error:
        raise MapError(f"{path}: cannot be read: {error.strerror}") from None
    if data[:2] in (b"P2", b"P5"):
        shade = _decode_pgm(path, data)
        return GrayImage(shade, np.ones_like(shade))
    return _read_with_pillow(path)


def _decode_pgm(path: Path, data: bytes) -> Float64[np.ndarray, "H W"]:
    (width, height, maximum), start = _pgm_header(path, data)
    count = width * height
    if data[:2] == b"P2":
        fields = b"".join(line.partition(b"#")[0] + b"\n" for line in data[start:].splitlines())
        try:
            values = np.array([int(field) for field in fields.split()], dtype=np.float64)
        except ValueError:
            raise MapError(f"{path}: a pixel of the P2 image is not a number") from None
    else:
        dtype = np.dtype(">u2") if maximum > 255 else np.dtype(np.uint8)
        body = data[start : start + count * dtype.itemsize]
        values = np.frombuffer(body[: len(body) // dtype.itemsize * dtype.itemsize], dtype=dtype)
    if values.size < count:
        raise MapError(
            f"{path}: the image is cut short: {values.size} of {width} × {height} pixels: copy it again"
        )
    shade = values[:count].reshape(height, width) / float(maximum)
    return np.clip(shade, 0.0, 1.0).astype(np.float64)


def _pgm_header(path: Path, data: bytes) -> tuple[tuple[int, int, int], int]:
    """Width, height and maximum of a PGM, and the offset of its pixels."""
    numbers: list[int] = []
    position = 2
    while len(numbers) < 3:
        while data[position : position + 1].isspace():
            position += 1
        if data[position : position + 1] == b"#":
            end = data.find(b"\n", position)
            position = len(data) if end < 0 else end
            continue
        end = position
        while data[end : end + 1].isdigit():
            end += 1
        if end == position:
            raise MapError(f"{path}: damaged PGM header: expected width, height and maximum")
        numbers.append(int(data[position:end]))
        position = end
    width, height, maximum = numbers
    if width < 1 or height < 1 or not 1 <= maximum <= 65535:
        raise MapError(f"{path}: impossible PGM header: {width} × {height}, maximum {maximum}")
    return (width, height, maximum), position + 1


def _read_with_pillow(path: Path) -> GrayImage:
    try:
        from PIL import Image, UnidentifiedImageError
    except ImportError:
        raise MapError(
            f"{path}: reading other images than PGM needs Pillow: pip install 'jaxslam[cli]'"
        ) from None
    try:
        with Image.open(path) as image:
            if image.mode.startswith("I"):  # 16-bit gray, which no conversion of Pillow scales.
                pixels = np.asarray(image, dtype=np.float64)[..., None] / 65535
                alpha = np.ones(pixels.shape[:2])
            else:
                channels = np.asarray(image.convert("RGBA"), dtype=np.float64) / 255
                pixels, alpha = channels[..., :3], channels[..., 3]
    except UnidentifiedImageError:
        raise MapError(f"{path}: not an image: expected PGM or PNG") from None
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise MapError(f"{path}: the image is cut short or damaged: {error}") from None
    return GrayImage(pixels.mean(axis=-1), alpha)
