"""Which columns of a file were read as times and positions, and in which units: factor * column in s and rad."""

from __future__ import annotations

from dataclasses import dataclass

from .units import Unit


@dataclass(frozen=True)
class Column:
    """Where the values of a quantity were read.

    Attributes
    ----------
    name : header of the column, or its number.
    unit : of the values in the file.
    origin : who states the unit: "header", "option", or "nobody".
    """

    name: str
    unit: Unit
    origin: str


@dataclass(frozen=True)
class Reading:
    """How a file was read.

    Attributes
    ----------
    time, position : the two columns.
    preamble : number of lines above header and samples that were left out.
    decimal : the decimal sign.
    """

    time: Column
    position: Column
    preamble: int = 0
    decimal: str = "."

    @property
    def sentence(self) -> str:
        """Columns and units in words."""
        parts = []
        for noun, column, base in (("times", self.time, "s"), ("positions", self.position, "rad")):
            unit = column.unit
            how = {
                "header": f"in {unit.name}",
                "option": f"in {unit.name} (as stated on the command line)",
                "nobody": f"taken as {unit.name} (the file states no unit)",
            }[column.origin]
            converted = f", converted to {base}" if unit.factor != 1 else ""
            parts.append(f"{noun} from column {column.name}, {how}{converted}")
        if self.preamble:
            parts.append(f"left out: {self.preamble} line{'s' * (self.preamble > 1)} of preamble")
        if self.decimal == ",":
            parts.append("commas taken as decimal signs")
        return "; ".join(parts)
