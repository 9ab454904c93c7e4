"""What is refused before any cycle is sought: no problem at all, and servos that are shown to have no cycle."""

from __future__ import annotations

from ..checks import COMPUTED, known, sensible
from ..errors import NoOrbit, Status
from .denial import no_cycle
from .event_map.scan import scan
from .hunting import MODELS, Model
from .servo import Servo, a_servo


def check_problem(servo: Servo, model: Model, gain: float) -> None:
    """Refuse what is no problem, and pure Coulomb friction with what a scan shows.

    Below a gain at which the loop without dry friction is stable, pure Coulomb friction proves nothing.  Of a bristle
    the proof for rigid friction proves nothing either: where a scan shows no cycle of it, none was found.

    servo, model, gain: the problem; gain K [V/rad]. Raises InputError: unknown model, or a gain that is not a finite
    number > 0.; NoOrbit: there is provably no cycle; or a scan of a bristle shows none, and none was found.
    """
    a_servo(servo)
    known("model", model, MODELS)
    sensible("gain", gain, power=COMPUTED)
    if servo.friction.static > servo.friction.coulomb:
        return
    if why := no_cycle(servo, model, gain):
        where = "any gain" if no_cycle(servo, model) else f"gain {gain:g} or above"
        seen = scan(model, servo, gain).sentence()
        raise NoOrbit(f"no hunting limit cycle of the {model} servo at {where}: {why}; at gain {gain:g}, {seen}")
    if why := no_cycle(servo, "switch", gain):
        bristles = scan(model, servo, gain)
        if bristles.upper is None:
            raise NoOrbit(
                f"no hunting limit cycle of the {model} servo was found at gain {gain:g}, which does not prove that "
                f"there is none: in the limit of stiff bristles there is none, because {why}, and with these bristles, "
                f"{bristles.sentence()}",
                Status.NOT_FOUND,
            )


def check_hunts(servo: Servo, model: Model) -> None:
    """Refuse a servo that is proved to have no cycle at any gain.

    Raises NoOrbit: there is such a proof (denial.py).
    """
    why = no_cycle(servo, model)
    if why:
        raise NoOrbit(f"no hunting limit cycle of the {model} servo at any gain: {why}")
