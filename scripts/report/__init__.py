"""The report's figures, one module per group; `scripts/figures.py` draws them and writes their captions.

    study.py        what the figures share: orbits, motions, branches, slices, each computed once
    drawing.py      how they look: titles, lines, axes
    response.py     1, 2    controller, hunting response
    state_space.py  3, 5    sections of the state space, bound of the stick phase
    cycles.py       4, 8, 11  limit cycles against time and in space
    branches.py     6, 7, 9, 10  bifurcation diagrams and Floquet multipliers
    regions.py      12, 13  regions of attraction: not in the report
    averages.py     which friction would explain the measured averages (docs/report.md)
    attraction.py   many initial states: which stick they reach, which rest and which hunt

A figure is a caption and a picture, both functions of the study.  No numerics here but those of
the regions of attraction; the library computes everything else.
"""
