"""What `casahunt simulate` says of a loop of parts."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from ...checks import error_text, to_absolute_error
from ...servo.outcome import SETTLES, Outcome
from .answer import Answer, angle, item, rhythm, short
from .simulate import counted, head_of

if TYPE_CHECKING:
    from ...servo.parts import LoopMotion


ELSEWHERE = "not looked at: with a remedy it may hunt from nearer to the set point; casahunt remedies looks there"
"""Said of a motion with a remedy that hunts no more."""


def loop_motion_answer(
    title: str, parts: str, found: LoopMotion, record: Mapping[str, Any], seen: Outcome,
    angles: Collection[str], names: Mapping[str, str],
) -> Answer:  # fmt: skip
    """What is said of a motion.

    title: which loop; parts: a line; record: its JSON object; seen: what becomes of it; angles: states that are some;
    names: what states are called, of a servo with a remedy.
    """
    motion = found.motion
    plain = [f"{title}, set point {record['set_point']:.10g} rad, {motion.duration:.10g} s: {head_of(seen)}"]
    plain.append(item("because", seen.sentence))
    if seen.kind == "hunting":
        plain += [item("amplitude", angle(seen.amplitude)), item("period", rhythm(seen.period))]
    if names and seen.kind in SETTLES:
        plain.append(item("other starts", ELSEWHERE))
    voltage = "" if record["peak_voltage"] is None else f", by {record['peak_voltage']:.4g} V"
    end = (
        f"{short(value)} rad from the set point" + ("" if names else f" ({state})")
        if state in angles else f"{names.get(state, state)} {short(value)}"
        for state, value in motion.end.items()
    )
    plain += [parts, item("at the end", ", ".join(end))]
    plain.append(item("largest torque", f"{record['peak_torque']:.4g} N m{voltage}"))
    return Answer(plain, _details(found, record))


def _details(found: LoopMotion, record: Mapping[str, Any]) -> Iterator[str]:
    motion = found.motion
    end = (
        f"{state} {to_absolute_error(value, motion.error * motion.sizes[state], most=10)}"
        for state, value in motion.end.items()
    )
    yield item("at the end", ", ".join(end))
    yield item("events", counted([event.event for event in motion.events]))
    yield item("error estimate", f"{error_text(motion.error)} (relative, of states and times of events)")
    yield item("status", f"{record['status'].name.lower()}, {record['wall_s']:.2f} s")
