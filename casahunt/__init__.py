"""casahunt: will this servo hunt, and which gain makes it stop?

Limit cycles of a position servo with dry friction and integral action, computed as multi-phase collocation
boundary value problems (CasADi, Newton and IPOPT), followed in the controller gain round the fold where hunting ends.

    >>> from casahunt import Servo, find_orbit, find_fold
    >>> orbit = find_orbit(Servo(), "switch", 0.04)                     # Table 1 of the report, gain K = 0.04
    >>> round(orbit.amplitude, 4), round(orbit.period, 3), orbit.stable  # rad, s
    (0.05, 10.281, True)
    >>> round(find_fold(Servo(), "switch").gain, 4)                     # no hunting above this gain
    0.6473

Eight rooms, each importing only from those to its left:

    hybrid < collocation < motion < orbits < continuation < servo < design < views

The first five solve periodic orbits of any hybrid system and know no servo.  The public names below are looked up when
they are first read: who uses a room loads nothing of those above it.  Each has an example in its docstring.  Pictures
are drawn by `casahunt.pictures`; systems of your own take `casahunt.hybrid`, `.motion`, `.orbits` and `.continuation`.
"""

from typing import TYPE_CHECKING, Any

from . import interrupts  # noqa: F401  first: on the command line it answers Ctrl-C during the imports that follow
from .lazy import lazily

if TYPE_CHECKING:
    from .axis_units import Units
    from .continuation.branch import Branch
    from .continuation.special_points import Missed, SpecialPoint
    from .continuation.walk import walk, walk_naturally
    from .design.diagram import diagram
    from .design.ensemble import FoldEnsemble, fold_ensemble, orbit_ensemble
    from .design.fold_curve import FoldCurve, fold_curve
    from .design.fold_map import FoldMap, fold_map
    from .design.identify.identify import Identification, identify
    from .design.record.file import Record
    from .design.record.measure import Measurement, measure
    from .design.remedies.cures import Cure, Cures
    from .design.remedies.remedies import remedies
    from .design.sensitivity import Sensitivities, fold_sensitivities
    from .design.tune.demands import Demands
    from .design.tune.tuning import Tuning, tune
    from .design.uncertainty.samples import Samples
    from .design.uncertainty.samples import sample as sample_fold_gains
    from .design.uncertainty.set import Uncertainty, load_uncertainty
    from .design.uncertainty.summary import Summary
    from .design.uncertainty.summary import summary as compare_uncertainty
    from .design.uncertainty.worst_corner import WorstCase, worst_corner
    from .errors import InputError, NoOrbit, Status
    from .orbits.adapt import Options
    from .orbits.archive import save_orbit
    from .orbits.ensemble import OrbitEnsemble
    from .orbits.floquet import Multipliers
    from .orbits.orbit import Arc
    from .servo.basin import Basin, basin
    from .servo.controller import Controller, Pid
    from .servo.denial import no_cycle
    from .servo.drive import Drive
    from .servo.equilibria import Equilibria, equilibria
    from .servo.event_map.fixed_points import FixedPoints, fixed_points
    from .servo.find_fold import find_fold
    from .servo.find_orbit import find_orbit
    from .servo.friction import Friction
    from .servo.linear.linear_loop import LinearLoop, linear_loop
    from .servo.linear.margins import Margins, margins
    from .servo.lopsided import with_lopsided
    from .servo.move import Move
    from .servo.outcome import Outcome
    from .servo.parts.file import load, load_drive
    from .servo.problem import HuntingFold as Fold
    from .servo.problem import HuntingOrbit as Orbit
    from .servo.sampled.check import AsBuilt, Cause, as_built, cause_of
    from .servo.sampled.motion import SampledMotion, simulate_sampled
    from .servo.saved import load_branch, load_orbit, save_branch
    from .servo.servo import Servo
    from .servo.simulate import simulate
    from .servo.trajectory import Trajectory
    from .views.explore.notebook import explore

__all__ = [
    "Arc", "AsBuilt", "Basin", "Branch", "Cause", "Controller", "Cure", "Cures", "Demands", "Drive", "Equilibria",
    "FixedPoints", "Fold", "FoldCurve", "FoldEnsemble", "FoldMap", "Friction", "Identification", "InputError",
    "LinearLoop", "Margins", "Measurement", "Missed", "Move", "Multipliers", "NoOrbit", "Options", "Orbit",
    "OrbitEnsemble", "Outcome", "Pid", "Record", "SampledMotion", "Samples", "Sensitivities", "Servo", "SpecialPoint",
    "Status", "Summary", "Trajectory", "Tuning", "Uncertainty", "Units", "WorstCase", "as_built", "basin", "cause_of",
    "compare_uncertainty", "diagram", "equilibria", "explore", "find_fold", "find_orbit",
    "fixed_points", "fold_curve", "fold_ensemble", "fold_map", "fold_sensitivities", "identify", "linear_loop",
    "load", "load_branch", "load_drive", "load_orbit", "load_uncertainty", "margins", "measure", "no_cycle",
    "orbit_ensemble", "remedies", "sample_fold_gains", "save_branch", "save_orbit", "simulate", "simulate_sampled",
    "tune", "walk", "walk_naturally", "worst_corner", "with_lopsided",
]  # fmt: skip
_public = lazily(__name__)
_FORMER_NAMES = {
    "diagram_points": "diagram(servo, model, report=function)",
    "sampled_margins": "margins(servo, gain, drive=drive)", "Verdict": "Outcome", "SampledVerdict": "Outcome",
}  # fmt: skip
"""Public names of earlier versions, and what is written today."""


def __getattr__(name: str) -> Any:
    """A public name, or `__version__` (the metadata of installed packages take 30 ms to import), when first read."""
    if name in _FORMER_NAMES:
        raise AttributeError(f"module 'casahunt' has no attribute {name!r}: write {_FORMER_NAMES[name]}")
    if name != "__version__":
        return _public(name)
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("casahunt")
    except PackageNotFoundError:  # run from a checkout that is not installed
        return "0+uninstalled"


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
