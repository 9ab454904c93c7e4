"""What can go wrong, in the words the user reads: statuses with advice, and the two exceptions.

Numerical failure is a `Status` on a result.  An exception is raised only at the user's border:
`InputError` (command line exit code 2) and `NoOrbit` (exit code 1).
"""

from __future__ import annotations

import copyreg
import math
from collections.abc import Callable
from enum import Enum
from functools import cached_property
from typing import Any


class InputError(ValueError):
    """The input is wrong: one sentence naming the key, the value and the allowed range.

    Examples
    --------
    >>> from casahunt import InputError, Servo
    >>> try:
    ...     Servo(inertia="0.1")
    ... except InputError as refusal:
    ...     print(refusal)
    servo.inertia = '0.1': must be a finite number, without quotes and unit
    """


class Status(Enum):
    """How a solve ended; the value is the sentence of advice that belongs to it.

    Examples
    --------
    >>> from casahunt import Servo, find_orbit
    >>> find_orbit(Servo(), "switch", 0.1).status.ok
    True
    """

    CONVERGED = "converged"
    NOT_CONVERGED = (
        "the collocation equations did not converge; start nearer to the orbit, take a smaller step "
        "in the parameter, or use a finer mesh"
    )
    NOT_FINITE = "the iteration met NaN or infinity; the starting guess is too far away or a parameter is extreme"
    SINGULAR = (
        "the linearised equations are singular: the orbit is at or past a fold, where no cycle continues in this "
        "parameter, or it is one of many at the same parameters"
    )
    INADMISSIBLE = (
        "the solution of the equations is no motion of the system (its phases are not in this order); "
        "search for another phase sequence"
    )
    FAR_FROM_GUESS = (
        "the solver converged to a root far from its starting point, perhaps on another branch; take a smaller step"
    )
    TOLERANCE_NOT_REACHED = (
        "the orbit is found but its error estimate stays above the tolerance, or the order of its phases is not clear "
        "on any mesh; ask for another tolerance"
    )

    NOT_FOUND = (
        "no cycle was found, which does not prove that there is none; simulate the system at these parameters, or try "
        "others near them"
    )

    FIT_NOT_CONVERGED = (
        "the fit stopped short of an optimum, so its values are none and it has no intervals; start from other values, "
        "or leave fewer parameters free"
    )

    @property
    def ok(self) -> bool:
        """True for a trustworthy result."""
        return self is Status.CONVERGED

    @property
    def advice(self) -> str:
        """The sentence to show to the user."""
        return self.value


class NoOrbit(Exception):
    """There is no such orbit, or it could not be computed; says what was tried and what to do.

    Attributes
    ----------
    status : the Status of the last solve, or None where there is no such cycle: a fold below the gain shows it, or a
        proof.
    plain : the message without its evidence.
    evidence : what supports it, in the words of the trade; "" where the message says it all.

    Examples
    --------
    >>> from casahunt import NoOrbit, Servo, find_orbit
    >>> try:
    ...     find_orbit(Servo(), "switch", 0.7)
    ... except NoOrbit as refusal:
    ...     print(str(refusal)[:58])
    no hunting limit cycle of the switch servo at gain 0.7: it
    """

    def __init__(self, message: str, status: Status | None = None, *, evidence: str = "") -> None:
        super().__init__(f"{message} ({evidence})" if evidence else message)
        self.status, self.plain, self.evidence = status, message, evidence

    def __reduce__(self) -> tuple[Any, ...]:
        """On the way to another process: made again by what it holds, for its message does not tell what made it."""
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]


class NotFollowed(NoOrbit):
    """A motion could not be followed for as long as was asked for; what stopped it is its evidence.

    Attributes
    ----------
    time : how far it was followed [s]; nan where that is not known.

    Examples
    --------
    >>> from casahunt.errors import NotFollowed
    >>> from casahunt.hybrid import Mode, System
    >>> from casahunt.motion import simulate
    >>> ends = System("ramp", ("x",), {}, (Mode("free", lambda x, p: {"x": 1}, holds=lambda x, p: 1 - x.x),))
    >>> try:
    ...     simulate(ends, x=0.0, duration=3.0)
    ... except NotFollowed as refusal:
    ...     print(str(refusal)[:75])
    the motion of ramp cannot be followed: at 1.5 the mode 'free' does not hold
    """

    def __init__(self, message: str, status: Status, *, evidence: str, time: float) -> None:
        beyond = f" beyond {time:.4g} s" if time > 0 else ""
        super().__init__(f"{message}{beyond}; try a shorter time, or another start", status, evidence=evidence)
        self.args = (f"{message}{beyond}: {evidence}. Else try a shorter time, or another start",)
        self.time = time


class HuntsIrregularly(NoOrbit):
    """No cycle was found, for the motion that was followed goes on for ever and repeats in no pattern.

    Attributes
    ----------
    amplitude : how far it turns back from the set point, at least and at most.
    between : the times between two turns, at least and at most [s].
    swing : a state of it, and sizes, as remedies begin with (servo/parts/fate.py); None where that is not known.
    exponent : of motions that lie side by side, d(t) = d(0) exp(exponent t), the largest [1/s], and its standard error;
        computed when it is first asked for (servo/parts/exponent.py); nan where it is not known.

    Examples
    --------
    >>> from casahunt.errors import HuntsIrregularly, Status
    >>> str(HuntsIrregularly("it hunts irregularly", Status.NOT_FOUND, amplitude=(0.1, 0.2), between=(1.0, 3.0)))
    'it hunts irregularly'
    """

    def __init__(
        self, sentence: str, status: Status, *, amplitude: tuple[float, float], between: tuple[float, float],
        swing: Any = None, measure: Callable[[], tuple[float, float]] | None = None,
    ) -> None:  # fmt: skip
        super().__init__(sentence, status)
        self.amplitude, self.between, self.swing, self._measure = amplitude, between, swing, measure

    @cached_property
    def exponent(self) -> tuple[float, float]:
        """The largest exponent [1/s] and its standard error."""
        return (math.nan, math.nan) if self._measure is None else self._measure()


class ComesToRest(NoOrbit):
    """No cycle was found, for the motion that was followed comes to rest.

    Examples
    --------
    >>> from casahunt.errors import ComesToRest
    >>> from casahunt.orbits import find_cycle
    >>> from casahunt.servo.parts import INERTIA, INTEGRATOR, PID_BY_TIMES, SWITCH, Loop
    >>> loop = Loop((INERTIA, SWITCH, PID_BY_TIMES, INTEGRATOR), {"gain": 1.0})
    >>> start = loop.at_rest(-1.0)
    >>> try:
    ...     find_cycle(loop.system, loop.mode_at(**start), start=start)
    ... except ComesToRest as refusal:
    ...     print(str(refusal)[:59])
    no cycle of servo was found: the motion comes to rest (foll
    """
