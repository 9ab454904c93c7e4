"""The commands, one module each: arguments, a call, text and JSON.

console.py   what they share: arguments, files, how numbers are shown
orbit.py, diagram.py, fold.py, fold_curve.py, loop.py, equilibria.py, map.py, basin.py, simulate.py, record.py,
uncertainty.py, tune.py
"""
