"""The measurements of scripts/benchmark.py.

rows.py     what is measured, how often, and what it is compared with
ours.py     casahunt on every scene, where its time goes, its memory
others.py   the peers on the same scenes
table.py    rows as text, ratios, work-precision diagrams
"""
