"""Amplitude and frequency of a measured or simulated motion.

    theta(t) = theta(t + T),    amplitude = (max - min)/2 over whole periods

units.py     units of time and angle as a header states them
reading.py   which columns were read, in which units; samples as other packages hand them out
file.py      a measured record, and how it is read from a file
period.py    the period, from the likeness of what is a lag apart
period_marks.py marks that divide a record into its periods
waveform.py  the waveform of a record, its peaks, the steps of a rounded position
verdict.py   is a divided record one of a limit cycle?
measure.py   all of it: `measure`
"""
