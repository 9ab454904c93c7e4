"""The words of the trade, each in one sentence for a control engineer who has never met it.

The one home of these sentences: the commands print them below an output that uses a word (commands/printed.py),
`casahunt glossary` prints them all, and a page of the documentation can be made of `GLOSSARY`.
"""

from __future__ import annotations

import re

GLOSSARY: dict[str, str] = {
    "admissible": "of a computed motion: it obeys the friction law all along; it never slips against its own "
    "direction and never sticks under a torque larger than static friction.",
    "amplitude": "the largest distance from the set point in a cycle.",
    "arclength": "the length along a curve of solutions; stepping in it instead of in the gain goes round the fold.",
    "branch": "cycles that change continuously with the gain; the stable branch is what the servo does, the unstable "
    "one is as a rule the border between hunting and coming to rest.",
    "bristle": "the state z of the LuGre friction model, a deflection of some hundred-thousandths of a radian.",
    "collocation": "the method of computing: the motion is written as polynomials on small intervals that obey the "
    "equations of motion at chosen times.",
    "corrector": "the iteration that brings the next point of a branch from a guess to the exact solution.",
    "cusp": "a point where a curve of fold gains turns back in the parameter: two folds meet there and vanish.",
    "cycle": "a motion that repeats itself period after period; a hunting cycle is one around the set point.",
    "dead band": "a band of small errors in which the integrator stands still; the servo may rest anywhere in it.",
    "dither": "a fast vibration on top of the torque that shakes friction loose; here by the averaged friction curve, "
    "which holds for a vibration much faster than the servo.",
    "elasticity": "per cent of change for one per cent more of a parameter.",
    "error dead band": "a band of small errors that the whole controller takes for none, proportional and derivative "
    "action too, while the integrator keeps its content.",
    "error filter": "a low pass on the error in front of the controller.",
    "event map": "where the servo sticks next: from a standstill at the distance a from the set point it breaks "
    "away, slips, and sticks at the distance P(a) on the other side; P(a) below a means that it comes nearer.",
    "feedforward": "friction compensation: the estimated friction is added to the torque, by the direction of the "
    "motion, so that only the rest of it is left; while the servo sticks there is no direction.",
    "fixed point": "a distance a that the event map repeats, P(a) = a: a hunting cycle of that amplitude.",
    "fold": "where hunting ends: the largest gain at which the servo can hunt, the fold gain; there the stable cycle "
    "has shrunk to the unstable one, and above it neither is left.",
    "freeze": "the integrator is stopped once the servo has stuck for a dwell time, until something moves it.",
    "generalised Jacobian": "all linearisations of an equation with a kink, one for each mixture of its two sides.",
    "grazing": "a cycle that only just touches the border between two kinds of motion, such as a slip that nearly "
    "stops; beyond it the order of slips and sticks is another one.",
    "half multiplier": "the factor by which a small disturbance of the cycle grows in half a period; below one in "
    "size it dies out, above one the cycle is unstable; negative: it changes sides each time.",
    "Hopf bifurcation": "where a cycle shrinks to a standstill, and ends.",
    "hunting": "a motion that never comes to rest about the set point: the servo sticks, the integral action pulls "
    "it loose, it slips past and sticks on the other side.",
    "hysteresis": "a dead band with two edges: the integrator stops where the error falls below the inner one, half of "
    "the size, and goes on where it rises above the outer one.",
    "IPOPT": "a solver of optimisation problems, here of the largest gain that still has a cycle.",
    "leak": "the integrator forgets its content at this rate, so that a small error at rest winds up no more than a "
    "bounded torque.",
    "lopsided": "of a cycle: it reaches farther to one side of the set point than to the other.",
    "LuGre": "the friction model with elastic contact: a bristle between the surfaces bends before they slip.",
    "mesh": "the small intervals that a computed motion is cut into.",
    "multiplier": "the factor by which a small disturbance of the cycle grows in one period; one of them, that of a "
    "shift in time, is one, and how far it is computed off that shows how accurate they are.",
    "natural continuation": "following a branch by steps in the gain itself; it ends at the fold.",
    "Newton": "Newton's method: the equations of the cycle solved by repeated linearisation.",
    "period doubling": "where a cycle hands over to one that repeats itself only every second period.",
    "phase sequence": "the order of slips and sticks in one period of the motion.",
    "reset": "the integrator's content is multiplied by this factor whenever the error goes through zero.",
    "reset at a stop": "the integrator's content is multiplied by this factor whenever the servo stops.",
    "Routh-Hurwitz": "the conditions on the coefficients of the characteristic polynomial for a stable linear loop.",
    "shifted dead band": "a dead band beyond whose edge only the part of the error outside it is integrated, so that "
    "nothing jumps at the edge.",
    "stable cycle": "the hunting cycle that the servo ends in.",
    "stick band": "a range of velocities so small that the motor counts as stuck in it; the exact model needs none.",
    "stick position": "where the motor stands still between two slips, as the distance from the set point.",
    "stick region": "the states in which static friction holds the motor.",
    "superstable": "of a cycle: its half multiplier is zero, so that a small disturbance is gone after half a period.",
    "Switch": "the exact friction model: the motor either sticks, up to static friction, or slips along the friction "
    "curve.",
    "symmetry breaking": "where the cycle that swings equally to both sides becomes unstable and lopsided cycles "
    "take over.",
    "torus": "where a cycle hands over to a motion with two frequencies.",
    "trivial multiplier": "the multiplier of a shift in time, one for every cycle; how far it is computed off that "
    "shows how accurate the others are.",
    "turning point": "where a curve of solutions turns back in its parameter; on a branch of cycles it is a fold.",
    "unstable cycle": "a cycle that motions near it leave; as a rule the border between those that come to rest and "
    "those that end in the stable cycle.",
    "worst corner": "the worst values: of all that the uncertain parameters may have, those with the largest fold "
    "gain: the servo that goes on hunting longest.",
}
"""Word: what it means."""
OTHER_FORMS = {
    "admissible": ("inadmissible",),
    "arclength": ("pseudo-arclength",),
    "branch": ("branches",),
    "corrector": ("correctors",),
    "elasticity": ("elasticities",),
    "event map": ("map of events",),
    "fold": ("fold gain", "fold gains"),
    "Hopf bifurcation": ("Hopf",),
    "mesh": ("meshes",),
    "grazing": ("grazings", "graze", "grazes"),
    "natural continuation": ("natural continuation in the gain",),
    "period doubling": ("flip", "flips"),
    "phase sequence": ("sequence of phases",),
    "hunting": ("hunt", "hunts"),
    "worst corner": ("worst friction", "worst values"),
}
"""Other spellings of a word than its plural in s."""
TEN_WORDS = ("amplitude", "cycle", "fold", "hunting", "lopsided", "LuGre", "stable cycle", "Switch", "unstable cycle",
             "worst corner")  # fmt: skip
"""The ten words of the plain answers: what else stands in them a control engineer knows, but for names of remedies."""
CHAPTERS = {
    "ten words, with which every answer can be read": TEN_WORDS,
    "words of --details, of the remedies and of these pages": tuple(word for word in GLOSSARY if word not in TEN_WORDS),
}
"""Headings, and the words below them."""
FAMILIAR = ("amplitude", "cycle", "hunting", "LuGre", "Newton", "stable cycle", "Switch", "unstable cycle")
"""Words that a control engineer knows, or that stand in every output: the glossary alone explains them."""


_FORMS = {form.lower(): word for word in GLOSSARY for form in (word, f"{word}s", *OTHER_FORMS.get(word, ()))}
_FOUND = re.compile(
    r"(?<![\w./-])(?<!casahunt )("  # names of files, options and commands are no words
    + "|".join(re.escape(form) for form in sorted(_FORMS, key=len, reverse=True))
    + r")(?![\w./]*\w)",
    re.IGNORECASE,
)


def words_in(text: str) -> list[str]:
    """The words of the trade that a text uses, in the order of their first use; names of files and options are none."""
    found = (_FORMS[match[1].lower()] for match in _FOUND.finditer(text))
    return [word for word in dict.fromkeys(found) if word not in FAMILIAR]


def sentence(word: str) -> str:
    """A word with what it means."""
    return f"{word}: {GLOSSARY[word]}"


def glossary_page() -> str:
    """The page docs/glossary.md of the documentation, which holds these sentences and nothing else."""
    parts = []
    for heading, words in CHAPTERS.items():
        entries = "\n\n".join(f"{word}\n    {GLOSSARY[word][0].upper()}{GLOSSARY[word][1:]}" for word in words)
        parts.append(f"## {heading[0].upper()}{heading[1:]}\n\n:::{{glossary}}\n{entries}\n:::\n")
    return "# Glossary\n\n" + "\n".join(parts)
