"""The page of `casahunt explore`: a servo that is turned, and at once what becomes of its hunting.

    page (browser) <-- websocket --> server <-- pipe --> worker: one process for each page, with an engine of its own

Bokeh draws and tornado carries; both are imported when the page is asked for.  The
controls are the browser's own: they have names for a screen reader, and the keyboard moves them.

state.py        what is asked: a servo or a loop, as an address and back
numbers.py      numbers and sentences as they are shown
page_stages.py  the stages of a servo and of a loop of parts
worker.py       a process that answers the newest question
page.py         the page as text; page.html, page.css, page.js
server.py       who may ask, and who answers
notebook.py     the page from Python
"""
