"""Pages: every number of a page stands in the JSON object beside it.

fragments.py       what pages are made of
record.py          the JSON object of a tuning
page.py            the page of a tuning: its evidence
remedies_page.py   the page of the remedies
cure_page.py       the page from records to a remedy
"""
