"""All remedies, in the order in which they are told of: one line for each file."""

from __future__ import annotations

from . import dead_band, dither, error_filter, feedforward, freeze, leak, plain, reset
from .remedy import Remedy

REMEDIES: tuple[Remedy, ...] = (
    *dead_band.REMEDIES,
    *leak.REMEDIES,
    *freeze.REMEDIES,
    *reset.REMEDIES,
    *error_filter.REMEDIES,
    *feedforward.REMEDIES,
    *dither.REMEDIES,
    *plain.REMEDIES,
)
