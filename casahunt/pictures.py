"""Pictures of the results, each drawn into your axes, or into those of a new figure.

    figure, (above, below) = plt.subplots(2)
    pictures.diagram([branch], ax=(above, below))       # as many axes as it has panels
    pictures.multipliers([branch], ax=other)            # one panel: one axes
    pictures.save(pictures.time_traces([orbit]), "orbit.png")

Every function returns the axes that it drew into, or an array of them; `save` writes their figure.  What has a table
draws itself, too: `orbit.plot("x1_rad", "x2_rad_per_s", ax=ax)` (casahunt/results.py).  matplotlib is imported when the
first of these names is read, pyplot never.
"""

from typing import TYPE_CHECKING

from .lazy import lazily

if TYPE_CHECKING:
    from .views.pictures.branches import diagram, multipliers
    from .views.pictures.equilibria import equilibria
    from .views.pictures.event_map import basin, cobweb
    from .views.pictures.fold_curve import elasticities, fold_curves, fold_map
    from .views.pictures.identify import fitted_records
    from .views.pictures.loop import bode
    from .views.pictures.orbits import phase_portrait, time_traces
    from .views.pictures.plotting import save
    from .views.pictures.remedies import remedy_sizes, rest_positions
    from .views.pictures.simulation import folded_record, motion, sampled_motion
    from .views.pictures.tune import operating_point, tasks
    from .views.pictures.uncertainty import histogram

__all__ = [
    "basin", "bode", "cobweb", "diagram", "elasticities", "equilibria", "fitted_records", "fold_curves", "fold_map",
    "folded_record", "histogram", "motion", "multipliers", "operating_point", "phase_portrait", "remedy_sizes",
    "rest_positions", "sampled_motion", "save", "tasks", "time_traces",
]  # fmt: skip
__getattr__ = lazily(__name__)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
