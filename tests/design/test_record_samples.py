"""Samples as other packages hand them out: what a record makes of them, and what it refuses."""

from __future__ import annotations

import datetime
from array import array
from decimal import Decimal

import numpy as np
import pytest

from casahunt import InputError, Record
from tests.peer_support import needs

T, Y = [0.0, 0.5, 1.0], [1.0, -2.0, 3.0]
NOON = datetime.datetime(2026, 7, 1, 12)
DATES = [NOON + datetime.timedelta(seconds=t) for t in T]


class Channel:
    """As h5py, TDMS and others have them: no array, but numpy makes one of it."""

    def __init__(self, values, kind=float):
        self.values = np.asarray(values, kind)

    def __array__(self, dtype=None, copy=None):
        return self.values if dtype is None else self.values.astype(dtype)

    def __len__(self):
        return len(self.values)


class Sequence:
    """With a length and items only."""

    def __len__(self):
        return 3

    def __getitem__(self, i):
        return Y[i]


@pytest.mark.parametrize("times", [
    T, tuple(T), Channel(T), Channel(T, np.float32), array("d", T), [0, Decimal("0.5"), 1], np.ma.masked_array(T),
    np.array([0, 500, 1000], "m8[ms]"), np.array([0, 5 * 10**8, 10**9], "M8[ns]") + np.timedelta64(56, "D"),
    Channel(["2026-07-01T12:00", "2026-07-01T12:00:00.5", "2026-07-01T12:00:01"], "M8[us]"),
    DATES, np.array(DATES, object), [each.replace(tzinfo=datetime.timezone.utc) for each in DATES],  # noqa: UP017
    [each - NOON for each in DATES],
])  # fmt: skip
def test_times_become_seconds(times):
    record = Record(times, Channel([1, -2, 3], int), torque=Sequence())
    for found, wanted in ((record.times, T), (record.position, Y), (record.torque, Y)):
        assert type(found) is np.ndarray and found.dtype == float and found.tolist() == wanted
    assert record.duration == 1.0 and record.after(0.2).position.tolist() == Y[1:]


def test_columns_of_pandas():
    pandas = needs("pandas")
    table = pandas.DataFrame({"t": T, "y": Y}, index=[7, 3, 9])
    summer = pandas.to_datetime("2026-07-01T12:00Z") + pandas.to_timedelta(table.t, unit="s")
    for times in (table.t, table.t.astype("Float64"), pandas.to_timedelta(table.t, unit="s"), pandas.Index(T),
                  summer, summer.dt.tz_convert("Europe/Berlin"), summer.dt.tz_localize(None)):  # fmt: skip
        record = Record(times, table.y)
        assert (record.times.tolist(), record.position.tolist()) == (T, Y)
    for missing in (pandas.Series([1.0, None, 3.0], dtype="Float64"), table.y.where(table.y > 0)):
        with pytest.raises(InputError, match="finite numbers"):
            Record(T, missing)
    with pytest.raises(InputError, match=r"equally many, not \(3,\) and \(3, 2\)"):
        Record(T, table)


@pytest.mark.parametrize(("times", "position", "sentence"), [
    (T, np.ma.masked_array(Y, [0, 1, 0]), "finite numbers, not NaN, infinity or masked; leave out the samples"),
    (np.ma.masked_array([0, 1, 2], [0, 1, 0]), Y, "finite numbers"),
    (T, [1.0, None, 3.0], "finite numbers"),
    (np.array(["2026-07-01", "NaT", "2026-07-03"], "M8[D]"), Y, "finite numbers"),
    (np.ma.masked_array(np.array([0, 1, 2], "m8[s]"), [0, 1, 0]), Y, "finite numbers"),
    (T, ["1", "2", "3"], "positions must be numbers, one of each sample"),
    (T, np.array(["1", "2", "3"], object), "positions must be numbers"),
    (T, [True, False, True], "positions must be numbers"),
    (T, [1j, 2j, 3j], "positions must be numbers"),
    (T, [[1.0], [2.0, 3.0], []], "positions must be numbers"),
    (T, DATES, "positions must be numbers, one"),
    (T, [each - NOON for each in DATES], "positions must be numbers, one"),
    (T, np.array([0, 1, 2], "m8[s]"), "positions must be numbers, one"),
    (["a", "b", "c"], Y, "times must be numbers, dates or durations"),
    ([NOON, 1.0, 2.0], Y, "times must be numbers, dates or durations"),
    (None, Y, "equally many"), (iter(T), Y, "times must be numbers"), ({0.0, 1.0}, Y, "times must be numbers"),
    (3.0, 4.0, "equally many"), ([], 1.0, "equally many"), ([[t] for t in T], Y, "equally many"),
    (T, [10**400] * 3, "positions must be numbers"), (DATES[::-1], Y, "must increase"),
])  # fmt: skip
def test_what_is_no_column_of_numbers(times, position, sentence):
    with pytest.raises(InputError, match=sentence):
        Record(times, position)
    if sentence.startswith("positions"):
        with pytest.raises(InputError, match="torques must be numbers"):
            Record(T, Y, torque=position)
