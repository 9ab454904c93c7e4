"""What all pictures share: the only import of matplotlib, figures, looks and files.

Results carry data, plotting takes results.  Every picture is a `matplotlib.figure.Figure` on an Agg canvas of its own:
no display, no pyplot, no global state.  `save` writes it.

A colour never says anything alone, so that the pictures survive grey printing: the Switch model is thin, dark
and square, the LuGre model wide, light and triangular; along a branch stable is solid, unstable is dashed.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from ...errors import InputError
from ...files import whole

Array = np.ndarray
Axes = Any

SIZE = (8.0, 6.0)
"""Width and height of a figure [in]."""
DPI = 150
SMALL = 9
"""Font size of legends and notes [pt]; the rest is matplotlib's 10."""
ALONE = 1.5
"""Line width [pt] where a wide line would only hide its own details."""
GAIN_LABEL = "controller gain K [V/rad]"


class Look(NamedTuple):
    """How the line of a model or of an orbit is drawn."""

    colour: str
    width: float
    marker: str
    zorder: float
    dashes: Any = "-"


LOOKS = {
    "switch": Look("#0b2f6b", 1.3, "s", 4),
    "lugre": Look("#f2a03d", 2.8, "^", 3),
}
MORE_LOOKS = (
    Look("#7a1f3d", 1.3, "D", 6, (0, (6, 2))),
    Look("#5fae8c", 2.2, "v", 5, (0, (1, 1.2))),
    Look("#555555", 1.3, "P", 7, (0, (6, 2, 1, 2))),
    Look("#b0509b", 1.8, "X", 5.5, (0, (2, 1))),
    Look("#111111", 1.0, "o", 8, (0, (10, 2, 1, 2, 1, 2))),
)
"""For orbits of a model that is in the picture already, in turn."""
NAMES = {"switch": "Switch", "lugre": "LuGre"}
NEUTRAL = "#444444"
"""Colour of what belongs to no model."""


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure.

    Parameters
    ----------
    figure
        the figure.
    path
        the file; its suffix decides on the format, PNG has 150 dpi.

    Raises
    ------
    InputError : the folder is missing or cannot be written to, or the suffix is unknown.
    OSError : the disk is full.
    """
    path = Path(path)
    suffixes = sorted(figure.canvas.get_supported_filetypes())
    suffix = path.suffix.lower().removeprefix(".")
    if suffix not in suffixes:
        raise InputError(f"figure {str(path)!r}: the suffix must be one of {', '.join(suffixes)}")
    if not path.parent.is_dir():
        raise InputError(f"figure {str(path)!r}: there is no folder {str(path.parent)!r}")
    content = drawn(figure, suffix)
    with whole(path) as stream:
        stream.write(content)


def drawn(figure: Figure, suffix: str = "png", dpi: float = DPI) -> bytes:
    """A figure as the content of a file.

    Parameters
    ----------
    figure, suffix
        the figure, and its format.
    dpi
        dots per inch.

    Returns
    -------
    The bytes.
    """
    stream = io.BytesIO()
    with _laid_out(figure, dpi) if suffix == "png" else nullcontext():
        figure.savefig(stream, dpi=dpi, format=suffix)
    return stream.getvalue()


@contextmanager
def _laid_out(figure: Figure, dpi: float) -> Iterator[None]:
    """The figure laid out for PNG; matplotlib itself would go through all that is in it once more for that."""
    engine, before = figure.get_layout_engine(), figure.dpi
    figure.dpi = dpi
    try:
        if engine is not None:
            engine.execute(figure)
            figure.set_layout_engine(None)
        yield
    finally:
        figure.dpi = before
        figure.set_layout_engine(engine)


def at_least_one(what: str, items: Sequence[Any]) -> None:
    """Refuse to draw nothing.

    Parameters
    ----------
    what
        what the items are.
    items
        what is to be drawn.

    Raises
    ------
    InputError : there is none.
    """
    if len(items) == 0:
        raise InputError(f"{what} = {items!r}: must be at least one to draw")


def new_figure() -> Figure:
    """An empty figure on an Agg canvas of its own."""
    figure = Figure(figsize=SIZE, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


__all__ = [
    "ALONE",
    "DPI",
    "GAIN_LABEL",
    "LOOKS",
    "MORE_LOOKS",
    "NAMES",
    "NEUTRAL",
    "SIZE",
    "SMALL",
    "Array",
    "Axes",
    "Figure",
    "FixedLocator",
    "FuncFormatter",
    "Line2D",
    "Look",
    "MaxNLocator",
    "NullLocator",
    "at_least_one",
    "drawn",
    "new_figure",
    "save",
]
"""What the pictures take from here, matplotlib's own among it."""
