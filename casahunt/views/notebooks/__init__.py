"""The guides as notebooks: one text, read as a page of the site and run as a notebook.

    guide (Markdown), example of the gallery (Python)  ->  cells  ->  notebook (JSON, nbformat 4)

cells.py    a text as cells: what is read, what is run
written.py  a notebook as a file, and whether it is still as it was written
guides.py   which there are, in the order in which they are read
"""
