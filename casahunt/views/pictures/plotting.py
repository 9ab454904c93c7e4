"""What all pictures share: the only import of matplotlib, figures, looks and files.

Results carry data, plotting takes results.  A picture is drawn into the axes that it is given, and else into a new
`matplotlib.figure.Figure` on an Agg canvas of its own: no display, no pyplot, no global state.  It returns the axes,
and `save` writes their figure.

A colour never says anything alone, so that the pictures survive grey printing: the Switch model is thin, dark
and square, the LuGre model wide, light and triangular; along a branch stable is solid, unstable is dashed.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from functools import wraps
from inspect import cleandoc
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec, TypeVar

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.scale import SymmetricalLogScale
from matplotlib.text import Text
from matplotlib.ticker import FixedLocator, FuncFormatter, LogFormatterSciNotation, MaxNLocator, NullLocator

from ...axis_units import in_its_units, shown
from ...checks import quoted
from ...errors import InputError
from ...export import MAKER
from ...files import whole_file

Array = np.ndarray
Axes = Any
P = ParamSpec("P")
R = TypeVar("R")

SIZE = (8.0, 6.0)
"""Width and height of a figure [in]."""
DPI = 150
"""Dots per inch of PNG: 1200 x 900, a screen's."""
SMALL = 9
"""Font size of legends and notes [pt]; the rest is matplotlib's 10."""
ALONE = 1.5
"""Line width [pt] where a wide line would only hide its own details."""
GAIN_LABEL = "controller gain K [V/rad]"
LEFT, RIGHT, BOTTOM, PANELS_APART = 0.85, 0.15, 0.5, 0.13
"""Room beside panels [in]: for a label and numbers of seven characters, half a number, a label and numbers, nothing."""
LABEL_LINE = 0.23
"""Distance of the edge of labels that is next to their panel from the edge of the figure [in]: a line and a gap."""
LEGEND_EDGE, LEGEND_ROW = 0.2, 0.19
"""Room for the frame of a legend above the panels, and for each of its rows [in]."""


class LineStyle(NamedTuple):
    """How the line of a model or of an orbit is drawn."""

    colour: str
    width: float
    marker: str
    zorder: float
    dashes: Any = "-"


LOOKS = {
    "switch": LineStyle("#0b2f6b", 1.3, "s", 4),
    "lugre": LineStyle("#f2a03d", 2.8, "^", 3),
}
MORE_LOOKS = (
    LineStyle("#7a1f3d", 1.3, "D", 6, (0, (6, 2))),
    LineStyle("#5fae8c", 2.2, "v", 5, (0, (1, 1.2))),
    LineStyle("#555555", 1.3, "P", 7, (0, (6, 2, 1, 2))),
    LineStyle("#b0509b", 1.8, "X", 5.5, (0, (2, 1))),
    LineStyle("#111111", 1.0, "o", 8, (0, (10, 2, 1, 2, 1, 2))),
)
"""For orbits of a model that is in the picture already, in turn."""
NAMES = {"switch": "Switch", "lugre": "LuGre"}
NEUTRAL = "#444444"
"""Colour of what belongs to no model."""
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
PNG = {"pil_kwargs": {"compress_level": 2}, "metadata": {"Software": MAKER}}
"""How PNG is written: a sixth longer than with the most work, in half the time, the same picture; and by whom."""


def save(picture: Any, path: str | Path) -> None:
    """Write a picture.

    Parameters
    ----------
    picture
        a figure, or the axes that a picture was drawn into, whose whole figure is written.
    path
        the file; its suffix decides on the format, PNG has 150 dpi.

    Raises
    ------
    InputError : the folder is missing or cannot be written to, or the suffix is unknown.
    OSError : the disk is full.

    Examples
    --------
    >>> from casahunt import Servo, find_orbit, pictures
    >>> import tempfile
    >>> from pathlib import Path
    >>> axes = pictures.time_traces([find_orbit(Servo(), "switch", 0.1)])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pictures.save(axes, Path(folder, "orbit.png"))
    ...     Path(folder, "orbit.png").read_bytes()[1:4]
    b'PNG'
    """
    path, figure = Path(path), figure_of(picture)
    suffixes = sorted(figure.canvas.get_supported_filetypes())
    suffix = path.suffix.lower().removeprefix(".")
    if suffix not in suffixes:
        raise InputError(f"figure {str(path)!r}: the suffix must be one of {', '.join(suffixes)}")
    if not path.parent.is_dir():
        raise InputError(f"figure {str(path)!r}: there is no folder {str(path.parent)!r}")
    content = drawn(figure, suffix)
    with whole_file(path) as stream:
        stream.write(content)


def drawn(figure: Figure, suffix: str = "png", dpi: float = DPI) -> bytes:
    """A figure as the content of a file."""
    stream = io.BytesIO()
    with _laid_out(figure, dpi) if suffix == "png" else nullcontext():
        figure.savefig(stream, dpi=dpi, format=suffix, **(PNG if suffix == "png" else {}))
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


def figure_of(drawn: Any) -> Figure:
    """The figure that axes, or an array of them, stand in; a figure's own is itself."""
    return drawn if isinstance(drawn, Figure) else np.ravel(np.asarray(drawn, dtype=object))[0].figure.canvas.figure


def png(axes: Any) -> bytes:
    """The figure of axes as the bytes of a PNG file, for a page."""
    return drawn(figure_of(np.ravel(np.asarray(axes, dtype=object))[0]), dpi=DPI * 2 // 3)


AX = """
ax
    where to draw: {axes}; default: those of a new figure.

Returns
-------
The {axes}.
"""
"""What the docstring of a picture says of its axes, below its other parameters."""
NO_AXES = """
Raises
------
InputError : what was given are no axes, or not as many as there are panels.
"""
"""And behind that, of a picture that refuses nothing else."""


def documented(doc: str, axes: str) -> str:
    """The docstring of a picture, with what is the same in all of them.

    doc, axes: what it says of its own, and which axes it draws into and returns.
    """
    said, title, examples = cleandoc(doc).partition("\nExamples\n")  # Python 3.13 has taken the margin off
    own, raises, refusals = said.partition("\nRaises\n")
    return f"{own.rstrip()}{AX.format(axes=axes)}{raises + refusals if raises else NO_AXES}{title}{examples}"


def picture(axes: str = "axes") -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Let a function draw in the units of what it is given; a label that is in SI of a rotary axis gets those in SI.

    axes: which ones it draws into and returns, for its docstring.
    """

    def of(draw: Callable[P, R]) -> Callable[P, R]:
        @wraps(draw)
        def inner(*arguments: P.args, **keywords: P.kwargs) -> R:
            drawn = draw(*arguments, **keywords)
            for text in figure_of(drawn).findobj(Text) if shown().linear else ():
                text.set_text(shown().relabelled(text.get_text()))
            return drawn

        inner.__doc__ = documented(draw.__doc__ or "", axes)
        return in_its_units(inner)

    return of


def in_one_unit(unit: str, *values: Any) -> tuple[str, tuple[Any, ...]]:
    """The unit in which arrays of one kind are drawn, and the arrays in it.

    unit: in SI, of a rotary axis; values: in SI.
    """
    sizes = [float(np.max(np.abs(some[np.isfinite(some)]), initial=0.0)) for some in map(np.asarray, values)]
    named = shown().near(max(sizes, default=0.0), unit)
    return named, tuple(shown().number(each, unit, named) for each in values)


def at_least_one(what: str, items: Sequence[Any]) -> None:
    """Refuse to draw nothing.

    Raises InputError: there is none.
    """
    if len(items) == 0:
        raise InputError(f"{what} = {items!r}: must be at least one to draw")


def new_figure() -> Figure:
    """An empty figure on an Agg canvas of its own."""
    figure = Figure(figsize=SIZE, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def panels(given: Any, rows: int, columns: int = 1, **how: Any) -> tuple[Figure | None, Array]:
    """Where a picture is drawn: the axes that were given, or those of a new figure.

    given: axes, one or several, or None; **how: for `Figure.subplots`, of a new figure.
    Returns the figure where it is a new one, else None; and the axes (rows * columns,), row by row.
    Raises InputError: other things than axes were given, or not as many as the picture has panels.
    """
    if given is None:
        figure = new_figure()
        return figure, np.ravel(np.asarray(figure.subplots(rows, columns, **how), dtype=object))
    axes = np.ravel(np.asarray(given, dtype=object))
    if axes.size != rows * columns or not all(hasattr(one, "plot") and hasattr(one, "transAxes") for one in axes):
        wanted = "matplotlib axes" if rows * columns == 1 else f"{rows * columns} matplotlib axes"
        raise InputError(f"axes = {quoted(given)}: must be {wanted}")
    return None, axes


def stacked(
    given: Any, heights: Sequence[float], *, legend_rows: int, right: float = RIGHT
) -> tuple[Figure | None, Array]:
    """As `panels`, one below the other over one abscissa, with places as of `fixed_grid`.

    given: axes, or None; heights: of the panels, relatively; legend_rows, right: as there.
    """
    if given is not None:
        return panels(given, len(heights))
    figure, grid = fixed_grid(legend_rows, nrows=len(heights), height_ratios=heights, right=right)
    axes = grid.subplots(sharex=True, squeeze=False)[:, 0]
    fix_labels(axes)
    return figure, axes


def fixed_grid(
    legend_rows: int, *, left: float = LEFT, right: float = RIGHT, rows_apart: float = PANELS_APART, **how: Any
) -> tuple[Figure, Any]:
    """A new figure and its grid, with places in inches: nothing is measured.

    To measure all labels twice, as a constrained layout does, takes as long as to draw them: this is for pictures whose
    numbers have seven characters at most.

    legend_rows: rows of the legend above; left, right, rows_apart: room beside and between the panels [in]; **how: for
    `GridSpec`.
    """
    figure = Figure(figsize=SIZE)
    FigureCanvasAgg(figure)
    (width, height), rows = SIZE, how["nrows"]
    top = height - LEGEND_EDGE - LEGEND_ROW * legend_rows
    apart = rows_apart * rows / (top - BOTTOM - rows_apart * (rows - 1))  # in mean heights of a panel
    edges = {"left": left / width, "right": 1 - right / width, "bottom": BOTTOM / height, "top": top / height}
    return figure, figure.add_gridspec(**{"ncols": 1, **how, **edges, "hspace": apart})


def fix_labels(axes: Sequence[Axes] | Array) -> None:
    """Give the labels of panels of a `fixed_grid` their places, in line below each other."""
    for ax in axes:
        box = ax.get_position()
        ax.xaxis.set_label_coords(0.5, (LABEL_LINE - BOTTOM) / (box.height * SIZE[1]))
        ax.yaxis.set_label_coords((LABEL_LINE - LEFT) / (box.width * SIZE[0]), 0.5)


def power(exponent: int) -> str:
    """A power of ten in plain text: a formula to be set costs 2 ms a label, and as much again for each of its kind."""
    return "10" + str(exponent).translate(RAISED)


class _Powers(LogFormatterSciNotation):
    """The labels of a logarithmic axis in plain text."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """The label at x; "" where there is none."""
        label = super().__call__(x, pos)
        plain = label.removeprefix(r"$\mathdefault{").removesuffix("}$").replace(r"\times", "×")
        plain = re.sub(r"10\^\{(-?\d+)\}", lambda found: power(int(found[1])), plain).replace("-", "−")
        return label if set("$\\{^").intersection(plain) else plain


def logarithmic(axes: Axes, *names: str, linear: float = 0.0) -> None:
    """Make axes of a panel logarithmic.

    linear: up to this size of either sign they are linear; 0: they have positive values alone.
    """
    for name in names:
        axes.set(**{f"{name}scale": SymmetricalLogScale(None, linthresh=linear) if linear else "log"})
        axis = getattr(axes, f"{name}axis")
        axis.set_major_formatter(_Powers())
        if not linear:
            axis.set_minor_formatter(_Powers(labelOnlyBase=False))


def legend(figure: Figure | None, axes: Axes, handles: Sequence[Any] | None = None, **how: Any) -> None:
    """The legend of a picture: outside of the panels of a new figure, inside of axes that were given.

    figure, axes: the new figure or None, and the panel that has room otherwise; handles: what it says; default: all
    that has a label; **how: for `Figure.legend`.
    """
    said = {} if handles is None else {"handles": handles}
    if figure is not None:
        figure.legend(**said, **{"loc": "outside upper center", "fontsize": SMALL, **how})
    else:
        axes.legend(**said, fontsize=SMALL)


__all__ = ["Figure", "FixedLocator", "FuncFormatter", "Line2D", "MaxNLocator", "NullLocator"]
"""Matplotlib's own, which the pictures take from here."""
