"""The stress test of scripts/stress.py.

cases.py    the questions of the grid, and what a verdict on one of them is
truth.py    what an answer is compared with
desk.py     cases solved, compared and judged
beyond.py   beyond the grid: perturbed starts, same bits, long branches, memory, leaks
table.py    the results as a picture, a table and a summary
"""
