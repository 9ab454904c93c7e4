"""Gain and controller of least cost that do not hunt.

    min cost(K, c)    such that    K >= (1 + margin) K_f(q), margins of phase and gain,    for all q of a set

c are the numbers of the controller that are free: tau_d, tau_i, or two of kp, ki, kd (servo/controller.py).

demands.py    what a tuning may be asked for: demands, bounds, costs
loop_set.py   the linear loops of a box of servos: the worst one, the gains that keep the margins
parts_set.py  the same of loops of parts, by their response
tasks.py      regulator tasks, simulated until they are decided
problem.py    one problem of a tuning for IPOPT
best_gain.py  a tuning with a given controller: the best gain for every servo of the set
search.py     the search over the controller's numbers, worst servos as cutting planes; what is in the way
check.py      what supports a tuning, computed apart from the search
tuning.py     all of it: `tune`
"""
