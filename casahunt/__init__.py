"""casahunt: will this servo hunt, and which gain makes it stop?

Limit cycles of a position servo with dry friction and integral action, computed as multi-phase collocation
boundary value problems (CasADi, Newton and IPOPT), followed in the controller gain round the fold where hunting ends.

    >>> from casahunt import Servo, find_orbit, find_fold
    >>> orbit = find_orbit(Servo(), "switch", 0.04)          # Table 1 of the report, gain K = 0.04
    >>> orbit.amplitude, orbit.period, orbit.half_multiplier
    >>> find_fold(Servo(), "switch").gain                    # no hunting above this gain
"""

from . import interrupts  # noqa: F401  first: on the command line it answers Ctrl-C during the imports that follow
from .adapt import Options
from .branch import Branch
from .continuation import walk, walk_naturally
from .diagram import collect, diagram
from .errors import InputError, NoOrbit, Status
from .find import find_orbit
from .floquet import Multipliers
from .fold import find_fold
from .friction import Friction
from .hunting_files import load_branch, load_orbit, save_branch, save_orbit
from .hunting_problem import HuntingFold as Fold
from .hunting_problem import HuntingOrbit as Orbit
from .monitor import SpecialPoint
from .orbit import Arc
from .record import Measurement, measure, record_of
from .record_file import Record, read_record
from .servo import Controller, Servo, load
from .simulate import simulate
from .trajectory import Trajectory
from .verdict import Verdict


def __getattr__(name: str) -> str:
    """`__version__`, looked up when read: the metadata of installed packages take 30 ms to import."""
    if name != "__version__":
        raise AttributeError(f"module 'casahunt' has no attribute {name!r}")
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("casahunt")
    except PackageNotFoundError:  # run from a checkout that is not installed
        return "0+uninstalled"


__all__ = [
    "Arc",
    "Branch",
    "Controller",
    "Fold",
    "Friction",
    "InputError",
    "Measurement",
    "Multipliers",
    "NoOrbit",
    "Options",
    "Orbit",
    "Record",
    "Servo",
    "SpecialPoint",
    "Status",
    "Trajectory",
    "Verdict",
    "collect",
    "diagram",
    "find_fold",
    "find_orbit",
    "load",
    "load_branch",
    "load_orbit",
    "measure",
    "read_record",
    "record_of",
    "save_branch",
    "save_orbit",
    "simulate",
    "walk",
    "walk_naturally",
]
