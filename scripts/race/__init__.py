"""The measurements of scripts/benchmark.py.

rows.py     what is measured, how often, and what it is compared with
ours.py     casahunt on every scene, where its time goes, its memory
others.py   the peers on the same scenes
taylor.py   heyoka on the scenes of the servo
table.py    rows as text, ratios, work-precision diagrams
scaling.py  many servos at once against their number, intervals and degree
entries.py  the problems of the gallery for all who race
gallery.py  casahunt and peers on the gallery
precision.py the gallery's table and work-precision diagrams
"""
