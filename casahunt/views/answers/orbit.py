"""What `casahunt orbit` says of a hunting cycle."""

from __future__ import annotations

from collections.abc import Iterator

from ...checks import error_text
from ...orbits import Multipliers, Orbit
from .answer import Answer, angle, complex_text, exactly, item, rhythm

CHECK = "their accuracy   the multiplier of a shift in time is 1 exactly, and was computed with an error of"
"""Said of the multipliers by either way."""
HEADS = {
    ("stable", True): "hunts",
    ("stable", False): "has a hunting cycle that it leaves again",
    ("stable", None): "has a hunting cycle; whether the servo ends in it is not known",
    ("lopsided", True): "hunts, farther to one side than to the other",
    ("lopsided", False): "has a lopsided hunting cycle that it leaves again",
    ("lopsided", None): "has a lopsided hunting cycle; whether the servo ends in it is not known",
}
"""By branch, and by whether the cycle is stable: what is said first."""
MEANS = {
    ("stable", True): "the servo swings like this for ever; what ends it: casahunt fold (a higher gain), casahunt "
    "remedies",
    ("stable", False): "a motion near it swings farther from it each time",
    ("lopsided", True): "the servo swings like this for ever, or in its mirror image",
    ("lopsided", False): "a motion near it swings farther from it each time",
}
"""By the same: what it means, where that is known."""
UNSTABLE = "motions near it leave it, so that no servo stays on it; as a rule it is the border of hunting:"
BOUNDS = "nearer to the set point it comes to rest, farther away it hunts; casahunt basin tries both"
RUNS_AWAY = (
    "the loop without dry friction is unstable at this gain (casahunt loop): from far enough the servo leaves the set "
    "point for good; casahunt simulate shows it"
)
"""Said where friction holds a cycle in that the linear loop would leave."""
SYMMETRY_BROKEN = "a cycle that reaches farther to one side may hunt in its place"


def orbit_answer(
    title: str, orbit: Orbit, branch: str, below: list[str], second: Multipliers | None, wall_s: float
) -> Answer:
    """What is said of a cycle.

    title: whose it is, and at which gain; below: lines of its own; second: its multipliers by integrators.
    """
    stable = orbit.stable
    if branch == "unstable":
        head, means = f"{title}: the unstable hunting cycle", [item("what it is", UNSTABLE), item("", BOUNDS)]
    else:
        said = MEANS.get((branch, stable), "") if stable is not None else ""
        head, means = f"{title}: {HEADS[branch, stable]}", [item("what it means", said)] if said else []
    plain = [
        head,
        item("amplitude", angle(orbit.amplitude, orbit.amplitude_error)),
        item("period", rhythm(orbit.period, orbit.period_error)),
        *means,
        *below,
    ]
    return Answer(plain, _details(orbit, second, wall_s))


def past_a_symmetry_breaking(orbit: Orbit) -> bool:
    """Whether lopsided cycles have branched off from a symmetric one."""
    return bool(orbit.half and orbit.multipliers.leading.real < -1)


def _details(orbit: Orbit, second: Multipliers | None, wall_s: float) -> Iterator[str]:
    m = orbit.multipliers
    yield from exactly(orbit)
    if m.trusted:
        if orbit.half:
            yield item("half multiplier", complex_text(m.leading, m.error, m.leading_floor))
        yield item("multipliers", _full_text(m))
        yield f"  {CHECK} {m.trivial_error:.1e}"
    else:
        yield item("multipliers", f"not to be trusted: {_doubt(m)}")
    if second is not None:
        yield from _second_lines(orbit, second)
    yield item(
        "status",
        f"{orbit.status.name.lower()} by {orbit.solver}, {orbit.unknowns} unknowns, {orbit.iterations} iterations, "
        f"{wall_s:.2f} s",
    )  # fmt: skip


def _full_text(m: Multipliers) -> str:
    """The multipliers of the whole period in a row."""
    return ", ".join(complex_text(value, m.error, floor) for value, floor in zip(m.full, m.full_floor, strict=True))


def _doubt(m: Multipliers) -> str:
    """Why they are not trusted."""
    if m.trivial_trusted:
        return f"the error of the largest one but the shift in time may be {error_text(m.error)}"
    return f"that of a shift in time, which is 1 exactly, was computed with an error of {m.trivial_error:.1e}"


def difference(one: Multipliers, other: Multipliers) -> float:
    """|mu_1 - mu_2| / max(1, |mu_1|) of the leading multipliers: next to a superstable cycle mu itself is 0."""
    return float(abs(one.leading - other.leading) / max(1.0, abs(one.leading)))


def _second_lines(orbit: Orbit, m: Multipliers) -> Iterator[str]:
    yield "  by integrators   (CasADi's forward sensitivities, from event to event)"
    if not m.trusted:
        yield f"    multipliers      not to be trusted: {_doubt(m)}"
        return
    if orbit.half:
        yield f"    half multiplier  {complex_text(m.leading, m.error, m.leading_floor)}"
    yield f"    multipliers      {_full_text(m)}"
    yield f"    {CHECK} {m.trivial_error:.1e}"
    if orbit.multipliers.trusted:
        off = difference(orbit.multipliers, m)
        yield f"    difference       {off:.1e} (of the largest one, relative where it is above 1)"
