"""Samples in a row, compiled, in which neither the plant nor the controller changes its mode.

    Z = (x, Y, torques on their way, last reading, whether it moved)  ->  Z a sample later, u, and whether all is well:
    one step of the plant's series is enough, no event of it can be met, and no mode of the controller ends
"""

from __future__ import annotations

import casadi as ca

from ...compiled import Caller, caller, kept
from .controller import Controller, Sample
from .plant import SHOWS, TOO_SMALL_TO_SHOW, Plant
from .steps import LAST_COEFFICIENTS, Stepped, step_of

TRIED_AT_ONCE = 4, 24
"""Samples that are tried at once: behind what ended a mode, and then."""


def in_a_row(plant: Plant, controller: Controller, seen: int, waiting: int, parted: bool) -> tuple[Caller, ...]:
    """As many samples as `TRIED_AT_ONCE` says; parted: a sample begins with the torque of the one before."""
    mode = plant.mode
    kinds = controller.q > 0, controller.step > 0, parted, controller.waits
    found: tuple[Caller, ...] = _compiled(
        mode.stepped, plant.held, controller.compiled, seen, waiting, kinds
    )
    return found


@kept(maxsize=256)
def _compiled(
    stepped: Stepped, held: int, sample: Sample, seen: int, waiting: int,
    kinds: tuple[bool, bool, bool, bool],
) -> tuple[Caller, ...]:  # fmt: skip
    """The same of a mode of the plant and modes of the controller; kinds: see above."""
    reads_counts, in_steps, parted, waits = kinds
    found = step_of(*stepped)
    assert found is not None  # the mode has a series
    step, n, parameters = found[0], stepped[3], stepped[4]
    Y_size, numbers = sample.step.size1_in(0), sample.step.size1_in(2)
    x, Y, W = ca.SX.sym("x", n), ca.SX.sym("Y", Y_size), ca.SX.sym("W", waiting)
    a_last, moved_last = ca.SX.sym("a"), ca.SX.sym("moved")
    q, theta_d, smallest, part, sign = (ca.SX.sym(name) for name in ("q", "theta_d", "smallest", "part", "sign"))
    sides = ca.SX.sym("sides", len(sample.edges) + 1)
    p, own = ca.SX.sym("p", parameters), ca.SX.sym("own", numbers)
    a = q * ca.floor((theta_d + x[seen]) / q + 0.5) - theta_d if reads_counts else x[seen]
    moved = a != a_last
    after, u, events = sample.step(Y, ca.vertcat(a, a_last, moved, ca.sign(a - a_last)), own)
    good = [
        edge.direction * (events[i] - beyond) <= 0 if edge.direction else sides[i] * events[i] > 0
        for i, (_, edge, beyond) in enumerate(sample.edges)
    ]
    good += [moved == moved_last, sides[-1] * after[-2] > 0] if waits else []
    u = smallest * ca.floor(u / smallest + 0.5) if in_steps else u
    torques = ca.vertcat(W, u)
    T = own[numbers - 2]
    state = x
    for torque, lasts in ((torques[0], part), (torques[1], T - part))[not parted :]:
        begins = ca.vertcat(state[:held], torque, state[held + 1 :])
        _, state, _, seen = step(begins, lasts, sign, p)
        tail, before, behind, most = ca.vertsplit(seen)
        good += [tail <= LAST_COEFFICIENTS, ca.logic_or(before >= TOO_SMALL_TO_SHOW, behind <= SHOWS), most < 0]
    well = ca.SX(1)
    for each in good:
        well = ca.logic_and(well, each)
    Z, more = ca.vertcat(x, Y, W, a_last, moved_last), ca.vertcat(q, theta_d, smallest, part, sign, sides)
    Z_after = ca.vertcat(state, after, torques[1:], a, moved)
    one = ca.Function("sample", [Z, more, p, own], [Z_after, u, well])
    sizes, several = [Z.numel(), more.numel(), parameters, numbers], []
    for count in TRIED_AT_ONCE:
        inputs = [ca.MX.sym("Z", sizes[0]), *(ca.MX.sym(f"i{i}", size) for i, size in enumerate(sizes[1:]))]
        rows = one.mapaccum("samples", count)(inputs[0], *(ca.repmat(each, 1, count) for each in inputs[1:]))
        several.append(caller(ca.Function("samples", inputs, rows), sizes, [(count, sizes[0]), (count, 1), (count, 1)]))
    return tuple(several)
