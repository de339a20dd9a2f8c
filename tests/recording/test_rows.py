"""Messages come back from rows as they were, to the last character."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.recording.container import DamageError
from adapters.recording.rows import RowReader, RowWriter, text_of

leaves = (
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False)
) | st.text()
names = st.text(max_size=4)
values = st.recursive(
    leaves,
    lambda of: st.lists(of, max_size=3) | st.dictionaries(names, of, max_size=3),
    max_leaves=8,
)
messages = st.lists(
    st.tuples(st.sampled_from(["/a", "/b"]), st.dictionaries(names, values, max_size=4)),
    max_size=4,
)


@given(batches=st.lists(messages, max_size=4))
def test_messages_are_read_as_they_were_written(
    batches: list[list[tuple[str, dict[str, Any]]]],
) -> None:
    writer, reader = RowWriter(), RowReader()
    for batch in batches:
        for topic, plain in batch:
            writer.put(topic, plain)
        data = writer.take()
        assert (data is None) is (not batch)
        read = [] if data is None else [(row.topic, row.data) for row in reader.rows(data)]
        assert read == [(topic, text_of(plain).encode()) for topic, plain in batch]


def test_names_are_written_once() -> None:
    writer = RowWriter()
    for number in range(3):
        writer.put("/a", {"name": number, "more": {"x": 1.0}})
    assert json.loads(writer.take() or b"") == {
        "shapes": [["/a", ["name", ["more", ["x"]]]]],
        "rows": [[0, 0, 1.0], [0, 1, 1.0], [0, 2, 1.0]],
    }
    writer.put("/a", {"name": 3, "more": {"x": 1.0}})
    assert json.loads(writer.take() or b"") == {"shapes": [], "rows": [[0, 3, 1.0]]}


@pytest.mark.parametrize(
    "batch",
    [
        b"",
        b"[]",
        b"{}",
        b'{"shapes":[],"rows":[[0,1]]}',
        b'{"shapes":[["/a",["x"]]],"rows":[[]]}',
        b'{"shapes":[["/a",["x"]]],"rows":[["x"]]}',
        b'{"shapes":[["/a",["x"]]],"rows":[[0]]}',
        b'{"shapes":[["/a",[1]]],"rows":[]}',
        b'{"shapes":1,"rows":[]}',
        b'{"shapes":[[[],["x"]]],"rows":[[0,1]]}',
        b'{"shapes":[["/a",[[["x"],[]]]]],"rows":[[0]]}',
        b'{"shapes":[["/a",["x"]]],"rows":[[-1,1]]}',
        b'{"shapes":[["/a",["x"]]],"rows":[[0,1,2]]}',
        b'{"shapes":[["/a",["x"]]],"rows":[[0,NaN]]}',
        b'{"shapes":[["/a",["x"]]],"rows":[[0,1e999]]}',
        b'{"shapes":[["/a",["x"]]],"rows":[[0,"\\ud800"]]}',
        b'{"shapes":[["/a",["x"]]],"rows":[[0,"\xed\xa0\x80"]]}',
        b'{"shapes":[["/a",["x"]]],"rows":[[0,' + b"1" * 10_000 + b"]]}",
        b"[" * 100_000,
        b'{"shapes":[],"rows":[' + b"[]," * 1_000_000 + b"[]]}",
    ],
)
def test_an_invalid_batch_is_reported(batch: bytes) -> None:
    with pytest.raises(DamageError):
        _ = [row.data for row in RowReader().rows(batch)]
