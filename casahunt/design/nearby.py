"""Folds of servos nearby: looked for where the fold of one of them lets them be expected.

    K(q) ~ K0 prod_i (q_i/q0_i)^e_i,    e_i = d ln K/d ln q_i at q0: positive everywhere, unlike the linear answer

One by one: the way to a fold starts at a cycle below the gain that is expected; where none is met there, from nothing.
Many at once are those of ensemble.py, which leaves to this what it cannot do.  A fold depends on its own servo and on
the fold from which it is predicted, not on what was computed before it.  A loop of parts has its friction as one of
them, and no model.

Units: K in V/rad.  Symbols: k parameters that differ, n servos, q (k,) values.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from ..axis_units import quantity
from ..checks import LARGEST, SMALLEST
from ..checks import choice_of as one_of
from ..continuation import Expansion, expansion
from ..errors import InputError, NoOrbit, Status
from ..orbits import Options
from ..servo.cold_start import stable_at
from ..servo.event_map.half_cycle import StickMap
from ..servo.event_map.scan import scan
from ..servo.find_fold import find_fold
from ..servo.friction import Model, pairs_of
from ..servo.parts.loop import Loop
from ..servo.parts.plain_loop import model_asked
from ..servo.parts.table import unit_of
from ..servo.servo import Servo
from .sensitivity import fold_sensitivities

Array = np.ndarray

BELOW = 0.7
"""Part of the predicted fold gain at which the way to the fold starts; the cold search costs three times as much."""


AnyFold = Any
"""A fold of a servo, whose orbit knows model, servo and gain, or one of a loop, whose orbit knows its problem."""


def check_asked(servo: Servo | Loop, model: Model | None) -> None:
    """Refuse what has no fold gain.

    Raises InputError: neither a servo with its friction model nor a loop alone, or a loop whose controller has no gain.
    """
    if model_asked(servo, model) is None and "gain" not in servo.names:
        parts = ", ".join(part.name for part in servo.present)  # type: ignore[union-attr]
        raise InputError(f"gain: must be a parameter of one of the parts, whose fold is asked for; {parts} have none")


def fold_near(servo: Any, model: Model | None, expected: float, options: Options) -> AnyFold | None:
    """The fold of a servo, or of a loop and no model, whose gain is about known.

    expected: its fold gain [V/rad], about; nan: unknown. Returns the fold; None where the servo cannot hunt. Raises
    NoOrbit: the fold was not computed.
    """
    if model is None:
        if np.isfinite(expected):
            with suppress(NoOrbit):
                return upper(find_fold(servo.replace(gain=BELOW * expected), options=options))
        return upper(find_fold(servo, options=options))
    start = None
    if np.isfinite(expected):
        with suppress(NoOrbit):  # where the prediction is too far off: from nothing
            rough = options.rough()
            met = stable_at(servo, model, BELOW * expected, options=rough)  # where it meets none, that proves nothing
            if met.orbit is not None and (met.clearly_stable or met.orbit.multipliers.leading.real <= 1):
                start = met.orbit
    try:
        return find_fold(servo, model, options=options, start=start)
    except NoOrbit as error:
        if error.status is not None:
            raise
        # A proof says that it hunts at no gain; the map at the expected gain is asked all the same.
        if np.isfinite(expected) and scan(StickMap("switch", servo, BELOW * expected)).upper is not None:
            sentence = f"{error}, but the event map has one near gain {expected:.4g}"
            raise NoOrbit(sentence, Status.NOT_CONVERGED) from None
        return None


def upper(fold: AnyFold) -> AnyFold:
    """A fold up to which there is hunting.  Raises NoOrbit: it hunts above it."""
    if fold.sense < 0:
        raise NoOrbit(f"hunting does not end above gain {fold.value:.6g}, it begins there", Status.NOT_FOUND)
    return fold


def values_of(owner: Any, names: Iterable[str]) -> Array:
    """Values of parameters of a servo, a loop, or the problem of an orbit.

    names: k names. Returns (k,) in SI. Raises InputError: there is none of that name, but for the gain.
    """
    known = [name for name in owner.names if name != "gain"]
    return np.array([owner.value(one_of("parameter", name, known)) for name in names])


def servo_at(servo: Any, names: Sequence[str], q: Array) -> Any:
    """The servo with other values of some parameters.

    names, q: k names, and (k,) their values. Raises InputError: the values are none of a servo.
    """
    return servo.replace(**{name: float(value) for name, value in zip(names, q, strict=True)})


def one_value(servo: Servo | Loop, name: str, value: float) -> Any:
    """The servo with another value, and the friction that leaves it the most room: static high, or Coulomb low.

    Raises InputError: the value alone is none.
    """
    pairs = pairs_of(servo)
    room = {static: {coulomb: SMALLEST} for static, coulomb in pairs.items()}
    room |= {coulomb: {static: LARGEST} for static, coulomb in pairs.items()}
    return servo.replace(**{name: value}, **room.get(name, {}))


def are_servos(servo: Servo | Loop, names: Sequence[str], rows: Array) -> Array:
    """Whether values in the box are of servos: static friction is at least Coulomb friction.

    servo, names, rows: the servo, k names, and (n, k) values of them. Returns (n,) bool.
    """
    values, good = dict(zip(names, rows.T, strict=True)), np.ones(len(rows), dtype=bool)
    for static, coulomb in pairs_of(servo).items():
        if static in values or coulomb in values:
            good &= values.get(static, servo.value(static)) >= values.get(coulomb, servo.value(coulomb))
    return good


def said(values: Mapping[str, float]) -> str:
    """Values of parameters in words."""
    each = ((name, quantity(value, unit_of(name), ".6g").rstrip()) for name, value in values.items())
    return ", ".join(f"{name} = {text}" for name, text in each)


def vectors(servo: Servo | Loop, names: Sequence[str], rows: Array) -> Array:
    """(n, np) parameters of a servo, k of them with other values (n, k); the gain, 1 V/rad, is to be found."""
    own = [1.0 if name == "gain" else servo.value(name) for name in servo.names]
    p = np.repeat(np.array(own)[None], len(rows), axis=0)
    p[:, [servo.names.index(name) for name in names]] = rows
    return p


def expected_gains(fold: AnyFold | None, names: Sequence[str], rows: Array) -> Array:
    """(n,) fold gains [V/rad] to be expected at values (n, k) of parameters, from a fold nearby; nan without one."""
    if fold is None:
        return np.full(len(rows), np.nan)
    q, elasticities = values_of(fold.orbit.problem, names), fold_sensitivities(fold).elasticities
    usable = (q > 0) & (rows > 0)
    logs = np.log(np.where(usable, rows, 1.0) / np.where(usable, q, 1.0))
    changes = np.where(usable, logs, 0.0) @ np.array([elasticities[name] for name in names])
    return np.asarray(fold.value * np.exp(np.clip(changes, -50, 50)))


def nominal_fold(
    servo: Servo | Loop, model: Model | None, options: Options, fold: AnyFold | None
) -> AnyFold | None:
    """The servo's own fold, computed where it is not given.

    fold: the fold, where known. Returns the fold; None where it cannot hunt or was not computed.
    """
    if fold is None:
        with suppress(NoOrbit):
            fold = fold_near(servo, model, np.nan, options)
    return fold


def fold_beside(
    servo: Servo | Loop, model: Model | None, known: AnyFold | None, *, options: Options | None = None
) -> AnyFold | None:
    """The fold of a servo, looked for where that of a servo nearby lets it be expected.

    known: that fold; None: it is looked for from nothing. Returns the fold; None where a proof shows that it hunts at
    no gain (servo/denial.py). Raises NoOrbit: it was not computed.
    """
    names = () if known is None else tuple(fold_sensitivities(known).elasticities)
    (expected,) = expected_gains(known, names, values_of(servo, names)[None]).tolist()
    return fold_near(servo, model, expected, options or Options())


def known_fold(servo: Servo | Loop, names: Sequence[str], fold: AnyFold | None, tol: float) -> Expansion | None:
    """The expansion from which servos near one are predicted.

    servo, names: the servo, and the parameters that differ from its own; tol: relative error of the folds that are to
    be computed.
    Returns expansion; None where there is no fold, its controller is given otherwise, or it could not be solved again.
    """
    if fold is None or fold.orbit.problem.names != servo.names:
        return None
    (own,), there = vectors(servo, (), np.empty((1, 0))), fold.orbit.problem.vector()
    differ = [name for name, a, b in zip(servo.names, own, there, strict=True) if name in names or a != b]
    with suppress(NoOrbit):
        return expansion(fold, tuple(differ), tol)
    return None
