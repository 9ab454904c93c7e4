"""What `casahunt tune` says of the gain that it recommends.

record: the JSON object of the tuning (commands/tune.py has its keys).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

from ...axis_units import quantity, word
from ...checks import to_error
from ...design.tune.demands import NUMBERS
from ...servo.outcome import SETTLES
from ...servo.units import unit_of
from .answer import ENDS, Answer, item, short
from .loop import stable_between

BINDS = {"hunting margin": "the distance that is kept from the gain where hunting ends"}
"""What keeps the cost from being less, where its name does not say it."""
NO_PARTS = "flexibility, noise, backlash, saturation"
PROVES_NOT = (
    f"that nothing else moves it: {NO_PARTS} and friction outside of what was given are "
    "not in the model; checks by simulation are samples"
)


def tuning_answer(
    record: Mapping[str, Any], tol: float, out: str | None, as_built: Sequence[str],
    as_built_in_full: Sequence[str] = (),
) -> Answer:  # fmt: skip
    """What is said of a tuning.

    tol: the error of what is computed to the tolerance and has no estimate of its own; out: where the evidence is;
    as_built, as_built_in_full: lines of the check in the loop as built, without and with what supports it.
    """
    return Answer(_plain(record, tol, out, as_built), chain(_details(record, tol), as_built_in_full))


def known_to(record: Mapping[str, Any], tol: float) -> float:
    """The relative error of the worst fold gain: what is estimated, and what two computations differ by."""
    check = record["verification"]
    return max(check["fold_error"], abs(record["fold_gain"] / check["fold_gain"] - 1)) if check["fold_gain"] else tol


def loop_name(name: str, corners: Mapping[str, Mapping[str, float]]) -> str:
    """What a linear loop of the checks is called."""
    return {"worst": "worst friction"}.get(name, f"least {name}" if name in corners else name)


def _plain(record: Mapping[str, Any], tol: float, out: str | None, as_built: Sequence[str]) -> Iterator[str]:
    check = record["verification"]
    whose = f"{record['model']} servo" if record["model"] else "loop"
    yield f"{whose}: recommended gain {short(record['gain'], tol)} V/rad{unless(record)}"
    if record["free"]:
        said = ", ".join(f"{n} {short(record[n], tol)} {unit_of(n)}".rstrip() for n in numbers_in(record))
        yield item(f"controller {form_of(record)}" if record["model"] else "free numbers", said)
    if record["cost"] != "gain" or record["free"]:
        only, form = record["cost_gain_only"], form_of(record)
        beside = "" if only is None else f" ({short(only, tol)} with the {form} as given)"
        yield item("cost", f"{record['cost']}: {short(record['cost_value'], tol)} {record['cost_unit']}{beside}")
    yield item("hunting", _hunting(record))
    yield item("why not less", ", ".join(BINDS.get(name, name) for name in record["binding"]) or "nothing")
    which = "the continuous loop is " if unless(record) else ""
    yield item("checked", f"{which}{check['result']}, in ways that the search for it did not use")
    yield item("linear loop", ("as built, " if record["demands"]["sample_time"] else "") + _loops(check))
    ends = [task["verdict"] for task in check["tasks"]]
    seen = ", ".join(f"{told.does} in {ends.count(kind)}" for kind, told in ENDS.items() if kind in ends)
    yield item("simulated", f"it {seen} of {len(ends)} motions; {_peak(check['tasks'])}")
    for sentence in check["against"]:
        yield item("against it", sentence)
    for sentence in check["unverified"]:
        yield item("not verified", sentence)
    left_out = NO_PARTS if record["model"] else "what is none of its parts"
    yield item("not proved", PROVES_NOT.replace(NO_PARTS, left_out))
    if out is not None:
        yield item("evidence", out)
    yield from as_built


def numbers_in(record: Mapping[str, Any]) -> list[str]:
    """The names of the controller's numbers; of a loop of parts of those that were free."""
    return [name for name in (NUMBERS if record["model"] else record["free"]) if name in record]


def form_of(record: Mapping[str, Any]) -> str:
    """What the numbers of the controller are called."""
    return "numbers" if not record["model"] else "gains" if "kp" in record else "times"


def unless(record: Mapping[str, Any]) -> str:
    """What the first line adds where the gain does not do in the loop as built."""
    kind = record.get("as_built", {}).get("kind", "at rest")
    if kind in SETTLES:
        return ""
    if kind == "undecided":
        return "; whether it comes to rest in the loop as built was not seen, see below"
    return f", but not alone: in the loop as built it {ENDS[kind].does} there, see below"


def _hunting(record: Mapping[str, Any]) -> str:
    """Up to which gain it hunts, with which values."""
    if not record["fold_gain"]:
        return "possible at no gain"
    where, fold, margin = record["worst"]["corner"], record["fold"], record["verification"]["margin"]
    said = f"possible up to gain {short(record['fold_gain'], known_to(record, 0.0))} V/rad"
    if where:
        said += f" with the worst values that are allowed ({worst_values(where)})"
        said += "" if fold["nominal"] is None else f", up to {short(fold['nominal'])} V/rad with those given"
    return said if margin is None else f"{said}; the gain is {short(100 * margin)} % above that"


def _loops(check: Mapping[str, Any]) -> str:
    """The least margins of the linear loops."""
    loops = list(check["loops"].values())
    if not all(loop["stable"] for loop in loops):
        return "not stable"
    lows, highs = ([loop[key] for loop in loops if loop[key]] for key in ("lowest_factor", "highest_factor"))
    limits = stable_between(max(lows, default=0.0), min(highs, default=math.inf))
    least = short(min(loop["phase_margin"] for loop in loops))
    no_licence = "with dry friction lower gains may hunt all the same"
    return f"phase margin {least} degrees; without dry friction it is stable {limits}, {no_licence}"


def _peak(tasks: Sequence[Mapping[str, Any]]) -> str:
    """What tasks ask of the motor."""
    torque, voltage = (max(task[key] for task in tasks) for key in ("peak_torque", "peak_voltage"))
    return f"at most {quantity(torque, 'N m', '.3g')}, {voltage:.3g} V"


def _details(record: Mapping[str, Any], tol: float) -> Iterator[str]:
    check, error, fold = record["verification"], known_to(record, tol), record["fold"]
    to = error if "hunting margin" in record["binding"] and not record["free"] else tol
    yield item("gain", f"{to_error(record['gain'], to)} V/rad")
    yield item("cost", f"{record['cost']}: {to_error(record['cost_value'], to)} {record['cost_unit']}")
    if record["fold_gain"]:
        yield item("hunting", f"possible up to gain {to_error(record['fold_gain'], error)} V/rad")
        if fold["nominal"] is not None:
            yield item("nominal", f"up to {to_error(fold['nominal'], fold['error'])} V/rad")
    if check["fold_gain"] is not None:
        again = to_error(check["fold_gain"], error)
        # K/K_fold - 1 has the error of K_fold.
        part = 1 + 1 / check["margin"] if check["margin"] else 1.0
        above = to_error(100 * check["margin"], abs(part) * error, most=6)
        yield item("fold once more", f"{again} V/rad; the gain is {above} % above it")
        if check["stable"]:
            yield item("it hunts", check["stable"]["sentence"])
    yield item("event map" if record["model"] else "motions", check["scan"])
    if check["set"]:
        number, largest = check["set"]["folds"], check["set"]["largest_fold_gain"]
        yield item("folds of the set", f"{number} corners and samples, the largest {to_error(largest, tol)} V/rad")
    for name, loop in check["loops"].items():
        if name == "nominal" or loop != check["loops"]["nominal"]:
            corners = check["loop_corners"]
            at = worst_values(corners.get(name, {}))
            what = loop_name(name, corners)
            where = f"{what} ({at})" if at else what
            low, high = loop["lowest_factor"] or 0.0, loop["highest_factor"]
            limits = stable_between(low, math.inf if high is None else high, "{:.5g}".format)
            stable = f"stable {limits}" if loop["stable"] else "unstable"
            yield item("linear loop", f"{where}: phase margin {loop['phase_margin']:.5g} degrees, {stable}")
    for task in check["tasks"]:
        said = f"{task['friction']} friction, {task['start']}: {ENDS[task['verdict']].does}, {_peak([task])}"
        yield item("simulated", said)
    yield "not proved by this"
    for sentence in record["proves_not"]:
        yield f"  {sentence}"
    yield f"  {record['wall_s']:.2f} s"


def worst_values(corner: Mapping[str, float]) -> str:
    """The values of a corner, in the units of the axis."""
    each = ((word(name), quantity(value, unit_of(name), ".6g")) for name, value in corner.items())
    return ", ".join(f"{name} = {value}".rstrip() for name, value in each)
