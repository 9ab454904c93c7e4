"""Pictures of the results, each drawn into your axes, or into those of a new figure.

    figure, (above, below) = plt.subplots(2)
    pictures.diagram([branch], axes=(above, below))     # several panels: axes=
    pictures.multipliers([branch], ax=other)            # one panel: ax=
    pictures.save(pictures.time_traces([orbit]), "orbit.png")

Every function returns the axes that it drew into, or an array of them; `save` writes their figure.  What has a table
draws itself, too: `orbit.plot("x1_rad", "x2_rad_per_s", ax=ax)` (casahunt/results.py).  matplotlib is imported when the
first of these names is read, pyplot never.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .views.pictures.branches import diagram, multipliers
    from .views.pictures.equilibria import picture as equilibria
    from .views.pictures.event_map import cobweb
    from .views.pictures.fold import elasticities
    from .views.pictures.fold_curve import regions as fold_curves
    from .views.pictures.fold_map import contours as fold_map
    from .views.pictures.loop import bode
    from .views.pictures.orbits import phase_portrait, time_traces
    from .views.pictures.plotting import save
    from .views.pictures.remedies import sizes
    from .views.pictures.simulation import folded as folded_record
    from .views.pictures.simulation import motion
    from .views.pictures.tune import operating_point
    from .views.pictures.tune import responses as tasks
    from .views.pictures.uncertainty import histogram

_HOME_OF = {
    "bode": ("loop", "bode"),
    "cobweb": ("event_map", "cobweb"),
    "diagram": ("branches", "diagram"),
    "elasticities": ("fold", "elasticities"),
    "equilibria": ("equilibria", "picture"),
    "fold_curves": ("fold_curve", "regions"),
    "fold_map": ("fold_map", "contours"),
    "folded_record": ("simulation", "folded"),
    "histogram": ("uncertainty", "histogram"),
    "motion": ("simulation", "motion"),
    "multipliers": ("branches", "multipliers"),
    "operating_point": ("tune", "operating_point"),
    "phase_portrait": ("orbits", "phase_portrait"),
    "save": ("plotting", "save"),
    "sizes": ("remedies", "sizes"),
    "tasks": ("tune", "responses"),
    "time_traces": ("orbits", "time_traces"),
}

__all__ = [
    "bode",
    "cobweb",
    "diagram",
    "elasticities",
    "equilibria",
    "fold_curves",
    "fold_map",
    "folded_record",
    "histogram",
    "motion",
    "multipliers",
    "operating_point",
    "phase_portrait",
    "save",
    "sizes",
    "tasks",
    "time_traces",
]


def __getattr__(name: str) -> Any:
    """A picture, when it is first read."""
    if name not in _HOME_OF:
        raise AttributeError(f"module 'casahunt.pictures' has no attribute {name!r}")
    module, own = _HOME_OF[name]
    value = globals()[name] = getattr(import_module(f".views.pictures.{module}", __package__), own)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
