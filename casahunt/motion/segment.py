"""One phase of a motion that was marched: its ends, and its intervals, made when somebody asks for them.

Symbols: n states, N intervals of a segment, R = n (d + 1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

Array = np.ndarray


class MarchFailure(Exception):
    """The march could not go on; the message says where.

    Attributes
    ----------
    time : how far it was followed, nan where that is not known.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.motion import MarchFailure, march
    >>> try:
    ...     march(
    ...         belt.vector_form, "slip", np.zeros(2), np.array(list(belt.parameters.values())),
    ...         scale=np.ones(2), until=lambda segment: False, max_intervals=1,
    ...     )
    ... except MarchFailure as failure:
    ...     print(str(failure).partition(";")[0])
    mode 'slip': no exit after 0.262 s and 1 intervals
    """

    time = float("nan")


class NoEnd(MarchFailure):
    """More intervals than there may be: the message says where, `time` how far the motion was followed with them."""

    def __init__(self, sentence: str, time: float = float("nan")) -> None:
        super().__init__(sentence)
        self.time = time


@dataclass(frozen=True, eq=False)
class Segment:
    """One phase of a simulated motion.

    Attributes
    ----------
    mode, event : names; event is "" where the march ended without one.
    duration : length of the segment [s].
    breaks : (N + 1,) interval boundaries as fractions of the duration; (2,) for a closed-form mode.
    w : (N, R) start and stages of each interval, unscaled; (1, n) for a closed-form mode,
        and starts (N, n) of steps where nobody wanted a mesh.
    end : (n,) state at the end.
    jumped : (n,) state behind the event where it jumps there, else None.
    length : [s] of the interval that would have come next; 0 where the phase was not followed by intervals.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.motion import march
    >>> slip, stick = march(
    ...     belt.vector_form, "slip", np.zeros(2), np.array(list(belt.parameters.values())),
    ...     scale=np.ones(2), until=lambda segment: segment.mode == "stick",
    ... )
    >>> slip.end.round(4).tolist() == stick.start.round(4).tolist()
    True
    """

    mode: str
    event: str
    duration: float
    breaks: Array
    w: Array
    end: Array
    jumped: Array | None = None
    length: float = 0.0

    @classmethod
    def followed(
        cls,
        ends: tuple[str, str, float, Array, Array, Array | None],
        count: int,
        mesh: Callable[[float], tuple[Array, Array]],
        tol: float,
    ) -> Segment:
        """A phase whose intervals are made when somebody asks for them, as few who only want its end do.

        Parameters
        ----------
        ends
            mode, event, duration, (n,) start and end, and the state behind the event.
        count
            number of the steps in which it was followed.
        mesh, tol
            makes `breaks` and `w` from the last Legendre coefficient of an interval; that coefficient.

        Returns
        -------
        Segment.
        """
        self = object.__new__(cls)
        names = ("mode", "event", "duration", "_start", "end", "jumped", "length", "_count", "_mesh", "_tol")
        for name, value in zip(names, (*ends, 0.0, count, mesh, tol), strict=True):
            object.__setattr__(self, name, value)
        return self

    def __getattr__(self, name: str) -> Any:
        """`breaks` and `w` of a phase that has none yet; two threads may both make them, and make the same."""
        mesh = self.__dict__.get("_mesh")
        if name not in ("breaks", "w") or mesh is None:
            raise AttributeError(name)
        for made, value in zip(("breaks", "w"), mesh(self._tol), strict=True):
            object.__setattr__(self, made, value)
        return self.__dict__[name]

    def meshed(self, tol: float) -> Segment:
        """The same phase with other intervals, where it has none yet.

        tol: last Legendre coefficient of each interval, in units of the states.
        Returns segment; as it is where it was followed by intervals, or in closed form.
        """
        if "_mesh" not in self.__dict__:
            return self
        ends = self.mode, self.event, self.duration, self._start, self.end, self.jumped
        return Segment.followed(ends, self._count, self._mesh, tol)

    def __getstate__(self) -> dict[str, Any]:
        """What is copied and sent to other processes."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def count(self) -> int:
        """Number of its intervals, or of the steps in which it was followed."""
        return int(self.__dict__["_count"]) if "_count" in self.__dict__ else len(self.w)

    @cached_property
    def nodes(self) -> Array:
        """(N + 1, n) states between its intervals and at both ends."""
        return np.vstack([self.w[:, : self.end.size], self.end])

    @property
    def start(self) -> Array:
        """(n,) state at the start."""
        return self.__dict__["_start"] if "_start" in self.__dict__ else self.w[0, : self.end.size]

    @property
    def behind(self) -> Array:
        """(n,) state behind the event: where the next segment starts."""
        return self.end if self.jumped is None else self.jumped
