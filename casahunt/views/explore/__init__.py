"""The page of `casahunt explore`: a servo that is turned, and at once what becomes of its hunting.

    page (browser) <-- websocket --> server <-- pipe --> worker: one process for each page, with an engine of its own

Bokeh draws and tornado carries; both are imported by figures.py and server.py alone, when the page is asked for.  The
controls are the browser's own: they have names for a screen reader, and the keyboard moves them.

state.py      what is asked: a servo or a loop, as an address and back
presets.py    servos to begin with
controls.py   what there is to turn, with units and ranges
copies.py     a state as a command line, as Python, as a file
numbers.py    numbers and sentences as they are shown
curves.py     branches of cycles and friction, as curves
kinds.py      the stages of a servo and of a loop of parts
answers.py    what the page shows, in stages
worker.py     a process that answers the newest question
figures.py    the figures, empty
page.py       the page as text; page.html, page.css, page.js
conversation.py  what one page asks and is told
server.py     who may ask, and who answers
notebook.py   the page from Python
"""
