"""The reference of the public names by topic: what one asks, in the order in which one asks it, and a page a name.

    names = union of `__all__` of the public modules = disjoint union of the topics' names

Who adds a name finds it a topic, or is refused here.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from casahunt.servo.parts import Part

MODULES = (
    "casahunt", "casahunt.pictures", "casahunt.servo.parts", "casahunt.hybrid", "casahunt.motion",
    "casahunt.collocation", "casahunt.orbits", "casahunt.continuation",
)  # fmt: skip
"""Public modules; what stands in several is told where it comes first."""


@dataclass(frozen=True)
class Topic:
    """A page of the reference; names: by module, separated by blanks; "" is all that no other topic has of it."""

    file: str
    title: str
    about: str
    names: dict[str, str]


TOPICS = (
    Topic("servo", "The servo",
          "What is given: inertia, controller, friction, the drive as built, and how to compute.", {
        "casahunt": "Servo Friction Controller Pid Drive Units load load_drive Options Status InputError NoOrbit",
    }),
    Topic("hunting", "Does it hunt?",
          "Its cycle at one gain, a motion and its verdict, the linear loop, where it may rest.", {
        "casahunt": "find_orbit Orbit Arc Multipliers orbit_ensemble OrbitEnsemble no_cycle simulate Move Trajectory "
        "Outcome simulate_sampled SampledMotion cause_of Cause basin Basin fixed_points FixedPoints "
        "equilibria Equilibria linear_loop LinearLoop margins Margins save_orbit load_orbit",
    }),
    Topic("border", "Where does it end?",
          "The fold, all cycles against the gain, and the border in two parameters.", {
        "casahunt": "find_fold Fold diagram Branch walk walk_naturally with_lopsided SpecialPoint "
        "Missed fold_curve FoldCurve fold_map FoldMap save_branch load_branch",
    }),
    Topic("certainty", "How sure is that?",
          "What the border hangs on, and the worst servo of those that friction allows.", {
        "casahunt": "fold_sensitivities Sensitivities Uncertainty load_uncertainty worst_corner WorstCase "
        "sample_fold_gains Samples compare_uncertainty Summary fold_ensemble FoldEnsemble",
    }),
    Topic("cure", "What stops it?",
          "Remedies with their prices, a tuned gain, a check in the loop as built, the page.", {
        "casahunt": "remedies Cures Cure tune Tuning Demands as_built AsBuilt explore",
    }),
    Topic("records", "From a record",
          "Amplitude and period of a measured motion, and friction from it.", {
        "casahunt": "Record measure Measurement identify Identification",
    }),
    Topic("loops", "Loops from parts",
          "Other plants, controllers, friction laws and loads, as parts that fit together.", {
        "casahunt.servo.parts": "",
    }),
    Topic("pictures", "Pictures",
          "Each draws a result; into your axes, where you give some.", {"casahunt.pictures": ""}),
    Topic("systems", "Any system",
          "Modes, events and jumps as data; the motion that follows from them.", {
        "casahunt.hybrid": "", "casahunt.motion": "", "casahunt.collocation": "",
    }),
    Topic("cycles", "Cycles of any system",
          "Periodic orbits, found, judged, kept, many at once.", {"casahunt.orbits": ""}),
    Topic("following", "Followed in parameters",
          "Branches of cycles and equilibria, special points, curves of those.", {
        "casahunt.continuation": "",
    }),
)  # fmt: skip


def names_by_topic() -> list[tuple[Topic, str, list[str]]]:
    """Topic, module and names, in order; a part is told by parts_pages.py.

    Raises ValueError: a public name has no topic, or a topic a name that is not public.
    """
    told: list[object] = []
    left: dict[str, list[str]] = {}
    for module in MODULES:
        room = import_module(module)
        things = {name: getattr(room, name) for name in sorted(room.__all__, key=str.lower)}
        left[module] = [n for n, x in things.items() if x not in told and not isinstance(x, Part | tuple)]
        told += things.values()
    pages = []
    for topic in TOPICS:
        for module, listed in topic.names.items():
            names = listed.split() or list(left[module])
            if missing := [name for name in names if name not in left[module]]:
                raise ValueError(f"{topic.title}: {module} has no {missing[0]}, or another topic has it")
            left[module] = [name for name in left[module] if name not in names]
            pages.append((topic, module, names))
    if forgotten := {module: names for module, names in left.items() if names}:
        raise ValueError(f"names without a topic in docs/api_pages.py: {forgotten}")
    return pages


def write(folder: Path) -> None:
    """Write index.rst and a page for each topic into a folder.

    Parameters
    ----------
    folder
        is made where it is missing.
    """
    folder.mkdir(parents=True, exist_ok=True)
    index = ["Python, by topic", "================", ""]
    for topic in TOPICS:
        index += [f":doc:`{topic.file}`", f"   {topic.about}", ""]
    index += [".. toctree::", "   :hidden:", "", *(f"   {topic.file}" for topic in TOPICS)]
    _keep(folder / "index.rst", index)
    pages: dict[str, list[str]] = {
        topic.file: [topic.title, "=" * len(topic.title), "", topic.about, ""] for topic in TOPICS
    }
    for topic, module, names in names_by_topic():
        pages[topic.file] += [f".. currentmodule:: {module}", "", f"In ``{module}``:", ""]
        pages[topic.file] += [".. autosummary::", "   :toctree: names", "", *(f"   {name}" for name in names), ""]
    for name, lines in pages.items():
        _keep(folder / f"{name}.rst", lines)


def _keep(page: Path, lines: list[str]) -> None:
    """Write a page, unless it is there already as it should be."""
    text = "\n".join(lines) + "\n"
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")
