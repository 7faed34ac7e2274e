"""Show results in a notebook: a picture and a table of the main numbers."""

import base64
import html
import io
from collections.abc import Mapping

from matplotlib.figure import Figure

from jaxslam.pipeline.result import AbstractResult


def result_png(result: AbstractResult) -> bytes:
    """Return the picture of a result as the bytes of a PNG file."""
    figure = Figure(figsize=(6.0, 5.0), layout="constrained")
    result.plot(figure.subplots())
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    return buffer.getvalue()


def result_html(result: AbstractResult, rows: Mapping[str, str]) -> str:
    """Return the picture of a result above a table of its main numbers, as HTML."""
    return image_html(result_png(result), "png", "map") + table_html(rows)


def image_html(data: bytes, kind: str, alt: str) -> str:
    """Return an HTML image that contains its data: the bytes of a file of the kind "png" or "gif"."""
    return f'<img src="data:image/{kind};base64,{base64.b64encode(data).decode()}" alt="{alt}">'


def table_html(rows: Mapping[str, str]) -> str:
    """Return a table of two columns, as HTML."""
    cells = "".join(
        f"<tr><th style='text-align:left'>{html.escape(name)}</th>"
        f"<td style='text-align:left'>{html.escape(text)}</td></tr>"
        for name, text in rows.items()
    )
    return f"<table>{cells}</table>"
