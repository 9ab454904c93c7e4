"""What the commands say, one module each: what it means first, and the mathematics behind it.

    plain     hunts or not, how large, how fast, how far from the border, what to do: the ten words of the glossary
    details   multipliers, fixed points, residuals, iterations, and every digit that is known: with --details, below it

answer.py     the form of all of them: plain lines, details, numbers
orbit.py, fold.py, diagram.py, map.py, basin.py, equilibria.py, simulate.py
sampled.py   simulate of the loop as built
loop.py, fold_curve.py, fold_map.py, uncertainty.py, tune.py, remedy_columns.py
"""
