"""Long kernels in pieces: the same values as in one, interpreted and compiled."""

from ctypes import CFUNCTYPE, c_void_p
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from dalembert.arrays import aligned
from dalembert.codegen.llvm import assembly
from dalembert.ir.interpret import interpret
from dalembert.ir.kernel import verify
from dalembert.lowering.programs import lower
from dalembert.mechanics.derive import derive
from dalembert.reduction import reduce
from dalembert.scene.reading import read
from dalembert.transforms.kernel_pieces import LONGEST, pieces_of
from mechanics.chains import chain

SIZES = [(100, 60), (100, 500), (0, 10_000)]


@pytest.fixture(scope="module")
def kernel():
    return lower(reduce(derive(read(chain("spatial", 6))), "minimal")).kernel("rhs")


def arguments(kernel, lanes=1):
    rng = np.random.default_rng(3)
    sizes = {load.array: 0 for load in kernel.loads} | {"t": 0}
    for load in kernel.loads:
        sizes[load.array] = max(sizes[load.array], load.index or 0)
    return {name: rng.uniform(0.5, 1.5, (sizes.get(name, 0) + 1, lanes)) for name in kernel.arguments}


@pytest.mark.parametrize(("longest", "size"), SIZES)
def test_pieces_compute_the_values_of_the_kernel(kernel, longest, size):
    pieces, count = pieces_of(kernel, longest, size)
    given = {name: array[:, 0].tolist() for name, array in arguments(kernel).items()}
    kept = [float("nan")] * count
    for piece in pieces:
        verify(piece.kernel)
        assert len(piece.kernel.body) <= size
        read_places = {load.index for load in piece.kernel.loads if load.array == "kept"}
        assert not read_places & set(piece.places), "a piece writes where it reads"
        found = interpret(piece.kernel, given | {"kept": kept})
        for place, value in zip(piece.places, found, strict=False):
            kept[place] = value
    assert found == interpret(kernel, given)
    assert sum(len(piece.kernel.body) for piece in pieces) == len(kernel.body)
    assert count < len(kernel.body) / 2, "places are used again"


def test_short_kernels_are_one_function(kernel):
    assert pieces_of(kernel) == ((), 0)
    assert len(kernel.body) < LONGEST


@pytest.mark.parametrize("lanes", [1, 4])
@pytest.mark.parametrize("heap", [False, True])
def test_machine_code_of_pieces_computes_the_same_bits(kernel, lanes, heap, monkeypatch):
    kernel = replace(kernel, name="whole")
    given = arguments(kernel, lanes)
    whole = run(kernel, given, lanes)
    monkeypatch.setattr(assembly, "pieces_of", partial(pieces_of, longest=100, size=150))
    if heap:
        monkeypatch.setattr("dalembert.codegen.llvm.target._LARGEST_FRAME", 8)
    text = assembly.assembly([("whole", kernel)], lanes)
    assert ("@malloc" in text) == heap and "whole.piece1" in text
    assert np.array_equal(run(kernel, given, lanes), whole)


def run(kernel, given, lanes):
    """Return the outputs (n_out, lanes) of compiled code."""
    text = assembly.assembly([(kernel.name, kernel)], lanes)
    code = assembly.load_object(assembly.compile_object(text))
    room = {name: aligned(len(array), lanes) for name, array in given.items()}
    for name, array in given.items():
        room[name].reshape(-1)[:] = array.ravel()
    out = aligned(len(kernel.outputs), lanes)
    function = CFUNCTYPE(None, *[c_void_p] * (len(given) + 1))(int(code.address(kernel.name)))
    function(*(room[name].ctypes.data for name in kernel.arguments), out.ctypes.data)
    return np.array(out).reshape(-1, lanes)
