"""Arguments of compiled loops: packed by their annotations, unpacked again, and refused where they do not fit."""

import ctypes
import pickle
import weakref
from typing import NamedTuple

import numpy as np
import pytest

from dalembert.subset.arguments import (
    NO_CODE,
    Address,
    AddressTable,
    AddressVector,
    FlagMatrix,
    IntVector,
    Matrix,
    OwnedAddress,
    Record,
    kind_of,
    place_of,
)
from dalembert.subset.packing import pack, unpack


class Shape(NamedTuple):
    n: int
    closed: bool
    cases: int


class Progress(Record):
    t: float
    steps: int


class Other(Record):
    t: float
    steps: int


class Arguments(NamedTuple):
    kernel: Address
    shape: Shape
    rtol: float
    states: Matrix
    marks: IntVector
    inside: FlagMatrix
    progress: Progress
    jumps: AddressVector


def arguments():
    arrays = np.ones((2, 3)), np.arange(4), np.eye(2, dtype=np.bool_)
    jumps = AddressTable([OwnedAddress(9, None), NO_CODE])
    return Arguments(OwnedAddress(7, None), Shape(5, True, 6), -0.5, *arrays, Progress(), jumps)


def test_integers_and_doubles_are_packed_by_their_bits_and_arrays_by_address_and_shape():
    given = arguments()
    words = pack(given)
    assert words[:4].tolist() == [7, 5, 1, 6]
    assert words[4:5].view(np.float64) == -0.5
    assert words[5:8].tolist() == [given.states.ctypes.data, 2, 3]
    assert words[8:10].tolist() == [given.marks.ctypes.data, 4]
    assert words[10:14].tolist() == [given.inside.ctypes.data, 2, 2, given.progress.words.ctypes.data]
    assert words[14:].tolist() == [given.jumps.words.ctypes.data, 2]
    assert len(words) == len(kind_of(Arguments).words)


def test_places_of_fields_are_those_of_their_words():
    words = pack(arguments())
    assert words[place_of(Arguments, "shape.cases")] == 6
    assert words[place_of(Arguments, "states") + 2] == 3
    assert place_of(Arguments, "shape") == place_of(Arguments, "shape.n") == 1
    with pytest.raises(KeyError, match=r"Arguments has no field shape\.lanes"):
        place_of(Arguments, "shape.lanes")


def test_unpacked_arguments_are_on_the_same_memory():
    given = arguments()
    found = unpack(Arguments, pack(given))
    assert found[:3] == given[:3]
    assert found.jumps.tolist() == [9, 0]
    found.states[1, 2], found.marks[3], found.inside[0, 1] = 4.0, -1, True
    found.progress.steps += 2
    found.progress.t = 0.25
    assert (given.states[1, 2], given.marks[3], given.inside[0, 1]) == (4.0, -1, True)
    assert (given.progress.t, given.progress.steps) == (0.25, 2)


def test_empty_arrays_and_those_that_cannot_be_written_are_packed():
    given = arguments()._replace(states=np.empty((0, 3)), marks=np.arange(2))
    given.marks.flags.writeable = False
    found = unpack(Arguments, pack(given))
    assert found.states.shape == (0, 3)
    assert found.marks.tolist() == [0, 1]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            {"states": np.ones((2, 3), np.float32)},
            r"Arguments\.states .*float64 with 2 .* array of float32",
        ),
        ({"states": np.ones(6)}, r"Arguments\.states .* is an array of float64 with 1 dimension"),
        ({"states": np.ones((3, 2)).T}, r"Arguments\.states .* not C-contiguous"),
        ({"marks": np.ones(3)}, r"Arguments\.marks must be .*int64"),
        ({"marks": [1, 2]}, r"Arguments\.marks .* of type list"),
        ({"inside": np.ones((2, 2), np.int64)}, r"Arguments\.inside must be .*bool"),
        ({"rtol": "much"}, r"Arguments\.rtol is 'much'"),
        ({"shape": Shape(5, True, 0.5)}, r"Arguments\.shape\.cases is 0\.5"),
        ({"kernel": 7}, r"Arguments\.kernel must be an address with its owner"),
        ({"jumps": np.zeros(2, np.int64)}, r"Arguments\.jumps must be an AddressTable"),
        ({"progress": Other()}, r"Arguments\.progress must be a record"),
        ({"progress": np.zeros(2, np.int64)}, r"Arguments\.progress must be a record of t, steps"),
    ],
)
def test_a_field_that_does_not_fit_is_named(changed, message):
    with pytest.raises(TypeError, match=message):
        pack(arguments()._replace(**changed))


def test_a_tuple_of_another_length_is_refused():
    with pytest.raises(TypeError, match=r"Arguments\.shape must have the fields n, closed, cases"):
        pack(arguments()._replace(shape=(1, 2)))


def test_fields_of_records_are_integers_and_doubles():
    with pytest.raises(TypeError, match=r"Flags\.seen must be int or float"):

        class Flags(Record):
            seen: bool


def test_an_address_keeps_its_owner_wherever_it_is_and_belongs_to_one_process():
    class Engine:
        """Stands for what has loaded code."""

    table, codes = AddressTable.zeros(2), [OwnedAddress(16 * (1 + i), Engine()) for i in range(2)]
    engines = [weakref.ref(code.owner) for code in codes]
    table[1] = codes[0]
    function = codes[1].function(ctypes.CFUNCTYPE(None))
    del codes
    assert (table.size, table[0], table[1], table.words.tolist()) == (2, 0, 16, [0, 16])
    assert engines[0]() is table[1].owner and engines[1]() is function.owner
    with pytest.raises(TypeError, match="neither pickled nor copied"):
        pickle.dumps(table[1])
    del table, function
    assert [engine() for engine in engines] == [None, None]
