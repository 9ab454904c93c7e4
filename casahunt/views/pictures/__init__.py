"""Pictures, each a function from results to a file.

plotting.py      what they share: the only import of matplotlib, figures, looks, files
orbits.py        time traces, phase portraits
branches.py      amplitude, period and multiplier against the gain
fold_curve.py    the gains with and without hunting against another parameter
loop.py          Bode pictures
event_map.py     cobweb picture of the event map
uncertainty.py   histogram of sampled fold gains
equilibria.py    stick region, generalised Jacobian
simulation.py    simulated motions, folded records
identify.py      records laid over the cycle that was fitted to them
remedies.py      amplitude against the size of each remedy, where the servo rests with it
tune.py          diagram with the operating point, the simulated tasks
"""
