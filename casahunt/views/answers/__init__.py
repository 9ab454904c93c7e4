"""What the commands say, one module each: what it means first, and the mathematics behind it.

    plain     hunts or not, how large, how fast, how far from the border, what to do: the ten words of the glossary
    details   multipliers, fixed points, residuals, iterations, and every digit that is known: with --details, below it

answer.py     the form of all of them; what one command alone says stands in its module
simulate.py, fold.py, loop.py, tune.py
"""
