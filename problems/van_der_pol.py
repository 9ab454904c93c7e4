"""Van der Pol's oscillator, from nearly harmonic to relaxation oscillations.

    x'' - mu (1 - x^2) x' + x = 0

It is the same under x -> -x, and so is its cycle: x(t + T/2) = -x(t), which is found without being told, and half the
cycle is computed.  By Liouville's formula its one nontrivial multiplier is

    exp(integral over T of mu (1 - x^2) dt),

8.6e-4 at mu = 1 and exp(-312) at mu = 10.  T = (3 - 2 ln 2) mu + 7.014 mu^(-1/3) + ... for large mu; at mu = 1000 the
two jumps of a period take a thousandth of it.

Beside it, on one machine: scipy's LSODA followed by solve_bvp (tol 1e-9), told by hand that half a period is enough,
takes 0.6 of the time of `find_cycle` at mu = 1 and 1.5 of it at mu = 10, and gives up at 20 000 nodes from mu = 100 on.

Source: B. van der Pol, On relaxation-oscillations, Philosophical Magazine 2 (1926) 978-992.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from casahunt.hybrid import Mode, System
from casahunt.orbits import find_cycle

from .gallery import Found, Truth, present

SYSTEM = System(
    "van der Pol's oscillator",
    states=("x", "v"),
    parameters={"mu": 1.0},
    modes=(Mode("smooth", field=lambda x, p: {"x": x.v, "v": p.mu * (1 - x.x**2) * x.v - x.x}),),
)

TRUTH = {
    1.0: Truth(6.66328685932313, {"x": (-2.008619860874843, 2.008619860874843),
                         "v": (-2.678441479606978, 2.678441479606978)}, (8.59695063629e-4,)),
    10.0: Truth(19.07836956693901, {"x": (-2.014285360926405, 2.014285360926405),
                         "v": (-14.18014728705647, 14.18014728705647)}, (0.0,)),
    100.0: Truth(162.8370710923700, {"x": (-2.001318681177224, 2.001318681177224),
                         "v": (-133.8016914555326, 133.8016914555326)}, (0.0,)),
    1000.0: Truth(1614.401125808334, {"x": (-2.000072966002597, 2.000072966002597),
                         "v": (-1333.562558192138, 1333.562558192138)}, (0.0,)),
}  # fmt: skip
"""By mu; scripts/peers/gallery_truths.py."""


def cycles(tol: float = 1e-9) -> Iterator[Found]:
    """The cycle for each mu."""
    for mu, truth in TRUTH.items():
        yield Found(f"mu = {mu:g}", find_cycle(SYSTEM, tol=tol, parameters={"mu": mu}, x=2.0, v=0.0), truth)


def draw(found: Sequence[Found], ax: Any) -> None:
    """x over the time from its largest value, in parts of the period."""
    for one in found:
        times, states = one.orbit.sample(16)
        turns = (times - one.orbit.extrema("x").high.time) / one.orbit.period % 1.0
        order = np.argsort(turns)
        ax.plot(turns[order], states[0, order], label=f"$\\mu$ = {one.orbit.parameters['mu']:g}")
    ax.set(xlabel="t / T", ylabel="x")
    ax.legend()


if __name__ == "__main__":
    present(cycles(), draw, "van der Pol's oscillator")
