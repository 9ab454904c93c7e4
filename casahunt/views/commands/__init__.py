"""The commands, one module each: arguments, a call, text and JSON.

`add` adds the arguments, `run` computes and prints, and returns the exit code.  Raises InputError: the command line or
a file is wrong; NoOrbit: nothing was found; KeyboardInterrupt, which says where what was computed so far is.

progress.py    where a command is: a line that moves, or milestones in a log
output.py      what is printed: 80 columns, words explained; CSV tables
output_paths.py what a command may write
taken.py       what a servo file leaves to Table 1
arguments.py   the arguments that they share, read and checked
pool.py        processes that a command shares its work out to
price_options.py the options of what a remedy costs, and of a move
record_options.py those by which they read a record
console.py     what else they share: files, how numbers are shown
sampled.py     what simulate does with the loop as built
orbit.py, diagram.py, fold.py, fold_curve.py, fold_map.py, loop.py, equilibria.py, map.py, basin.py, simulate.py,
record.py, identify.py, uncertainty.py, remedies.py, cure.py, tune.py, explore.py, glossary.py
"""
