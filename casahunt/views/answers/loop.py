"""What `casahunt loop` says of the linear loop without dry friction."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

from ...axis_units import quantity
from ...servo.linear.linear_loop import LinearLoop
from ...servo.linear.margins import Margins
from ...servo.units import GAIN_UNIT
from .answer import Answer, item, short, volts_per
from .simulate import drive_said

if TYPE_CHECKING:
    from ...servo.drive import Drive


def loop_answer(
    loops: Sequence[LinearLoop], limits: tuple[float, float] | None = None, drive: Drive | None = None,
    built: Sequence[Margins] = (), within: Sequence[str] = (),
) -> Answer:  # fmt: skip
    """What is said of linear loops.

    limits: of one inertia, the lowest stable gain with viscous friction, and without any [V/rad]; drive, built: the
    drive where the file describes one, and the margins as built; within: names of the parts that saturate.
    """
    kind = " as a continuous loop" if built else ""
    plain = [f"linear loop{', continuous' if built else ''}, dry friction left out"]
    if limits is not None:
        plain.append(f"  with viscous friction     {_stable_from(limits[0])}")
        plain.append(f"  without any friction      {_stable_from(limits[1])}")
    for loop in loops:
        plain.append(f"gain {_stated(loop.gain)}{kind}{_way(loop)}: {'stable' if loop.stable else 'unstable'}")
        for c in loop.gain_crossovers:
            plain.append(item("phase margin", f"{short(c.margin)} degrees at {short(c.frequency)} rad/s"))
        becomes, stays = ("unstable", "stable") if loop.stable else ("stable", "unstable")
        factors = [short(x) for x in (loop.lowest_factor, loop.highest_factor) if 0 < x < math.inf]
        ends = "; ".join(f"{becomes} where the gain is multiplied by {x}" for x in factors)
        plain.append(item("gain margin", ends or f"none: {stays} at every gain"))
    for loop, margins in zip(loops, built, strict=bool(built)):
        between = stable_between(margins.lowest_factor, margins.highest_factor)
        said = f"phase margin {short(margins.phase_margin)} degrees, stable {between}" if margins.stable else "unstable"
        plain.append(f"gain {_stated(loop.gain)} as built{_way(loop)}: {said}")
    if within:
        plain.append(item("within", f"its {' and '.join(within)}; larger motions are others: casahunt simulate"))
    if drive is not None:
        said = "; ".join(drive_said(drive.exact().quiet()))
        left = "what is not linear in it is left out; a picture (--plot) shows both"
        plain.append(item("as built", f"the sampled loop, {said}; {left}"))
    plain.append("A stable linear loop does not say that the servo does not hunt: dry friction is not in it.")
    return Answer(plain, _details(loops, limits))


def _stated(gain: float) -> str:
    return quantity(gain, GAIN_UNIT, ".10g")


def _way(loop: LinearLoop) -> str:
    return f", with the viscous friction of a motion {loop.direction}" if loop.direction else ""


def _stable_from(gain: float) -> str:
    if gain == 0:
        return "stable at every gain"
    if not math.isfinite(gain):
        return "stable at no gain"
    return f"stable at every gain above {volts_per(gain)}"


def stable_between(low: float, high: float, written: Callable[[float], str] = short) -> str:
    """Between which factors of the gain a loop is stable; 0 and infinity where nothing limits it."""
    falls = f"down to {written(low)} times the gain" if low else "at any lower gain"
    rises = f"up to {written(high)} times" if math.isfinite(high) else "at any higher one"
    return f"{falls} and {rises}"


def _details(loops: Sequence[LinearLoop], limits: tuple[float, float] | None) -> Iterator[str]:
    if limits is not None:
        yield f"  Routh-Hurwitz    K > {_stated(limits[0])} with viscous friction, K > {limits[1]:.10g} without any"
    for loop in loops:
        yield f"  gain {_stated(loop.gain)}{_way(loop)}"
        poles = (f"{p.real:.8g}{p.imag:+.8g}j" if p.imag else f"{p.real:.8g}" for p in loop.poles)
        yield f"    poles          {', '.join(poles)} 1/s"
        for c in loop.gain_crossovers:
            yield f"    phase margin   {c.margin:.8g} degrees at {c.frequency:.8g} rad/s, where |L| = 1"
        factors = (f"{factor:.8g}" for factor in (loop.lowest_factor, loop.highest_factor) if 0 < factor < math.inf)
        yield f"    gain margin    {', '.join(factors) or 'none'}"
