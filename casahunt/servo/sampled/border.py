"""When an encoder may decide how a servo hunts: a border for the amplitude of the continuous cycle, in counts.

    A < ENCODER_BORDER q,    q = 2 pi/encoder one count [rad]

Where the continuous loop rests, a set point between two counts leaves an error that the integral winds up on, unless it
has a dead band: the drive hunts by a count.
"""

from __future__ import annotations

from ..drive import BANDS, Drive

ENCODER_BORDER = 20.0
"""Counts of the amplitude of hunting by stiction below which an encoder may decide how it hunts.  Of 60 random servos
(scripts/as_built.py encoder) quantisation was the cause, as of cause.py, of none with 40 counts or more, 12 % with 20,
28 % with 12, 40 % with 8, 61 % with 5 and nine tenths with 3 or less."""


def below_border(amplitude: float, drive: Drive | None) -> str:
    """The sentence for a cycle of the continuous loop that an encoder sees in few counts; "" where there is none.

    amplitude: of the cycle [rad].
    """
    if drive is None or not drive.encoder or amplitude >= ENCODER_BORDER * drive.count:
        return ""
    counts = f"{amplitude / drive.count:.3g} counts of the encoder"
    return f"{counts}: below {ENCODER_BORDER:g} quantisation may decide how it hunts, not stiction alone"


def by_counts(drive: Drive | None) -> str:
    """The sentence for a gain at which the continuous loop does not hunt, and this drive may; "" where it may not."""
    if drive is None or not drive.quantises or any(getattr(drive, key) for key in BANDS) or drive.dwell is not None:
        return ""
    what = "a count of the encoder" if drive.encoder else "a step of the torque"
    may = f"may keep the drive hunting by {what} where the continuous loop rests"
    return f"quantisation, which no gain takes away, {may}"
