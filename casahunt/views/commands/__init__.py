"""The commands, one module each: arguments, a call, text and JSON.

arguments.py   the arguments that they share, read and checked
console.py     what else they share: progress, files, how numbers are shown
orbit.py, diagram.py, fold.py, fold_curve.py, fold_map.py, loop.py, equilibria.py, map.py, basin.py, simulate.py,
record.py, uncertainty.py, tune.py
"""
