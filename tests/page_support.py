"""What the tests of pages share: their elements with a key, and that every number is in one."""

from __future__ import annotations

import re
from html.parser import HTMLParser

from casahunt.views.evidence.fragments import value_at


class Reader(HTMLParser):
    """Elements with a key, and the text outside of them."""

    def __init__(self) -> None:
        super().__init__()
        self.keyed: list[tuple[dict, str]] = []
        self.outside: list[str] = []
        self.sources: list[str] = []
        self._open: dict | None = None
        self._silent = 0

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.sources += [found[name] for name in ("src", "href") if name in found]
        self._silent += tag in ("style", "script")
        if "data-key" in found:
            assert self._open is None
            self._open = found
            self.keyed.append((found, ""))

    def handle_endtag(self, tag):
        self._silent -= tag in ("style", "script")
        if self._open is not None and tag in ("data", "span"):
            self._open = None

    def handle_data(self, data):
        if self._silent:
            return
        if self._open is not None:
            self.keyed[-1] = (self._open, self.keyed[-1][1] + data)
        else:
            self.outside.append(data)


def every_number_has_its_key(reader: Reader, record: dict) -> None:
    """No number stands outside of an element with a key, and all are those of the record."""
    stray = [data for data in reader.outside if re.search(r"\d", data)]
    assert not stray
    for attributes, shown in reader.keyed:
        value = value_at(record, attributes["data-key"])
        if "value" in attributes:
            assert float(attributes["value"]) == value
            factor = float(attributes.get("data-factor", 1))
            assert shown == format(value * factor, attributes["data-form"]).replace("-", "\N{MINUS SIGN}")
        else:
            assert shown == ("\N{EN DASH}" if value is None else str(value))
