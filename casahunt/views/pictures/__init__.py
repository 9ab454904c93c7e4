"""Pictures, each a function from results to a file.

plotting.py      the only import of matplotlib; diagrams and orbits
fold.py          elasticities of a fold
fold_curve.py    the gains with and without hunting against another parameter
loop.py          Bode pictures
event_map.py     cobweb picture of the event map
uncertainty.py   histogram of sampled fold gains
equilibria.py    stick region, generalised Jacobian
simulation.py    simulated motions, folded records
tune.py          diagram with the operating point, tasks before and after
"""
