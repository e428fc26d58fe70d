"""Pipelines verify before and after each pass, record what passes do, and are data."""

from dataclasses import FrozenInstanceError, dataclass, fields, is_dataclass, replace
from itertools import pairwise
from typing import ClassVar

import pytest

from dalembert.ir.kernel import Kernel, MalformedKernel
from dalembert.ir.program import Layout, Program
from dalembert.transforms import pipelines
from dalembert.transforms.passes import EliminateDeadCode, ShareEqual
from dalembert.transforms.pipelines import KERNEL_PASSES, PROGRAM_PASSES, Pipeline

KERNEL = Kernel.parse(
    """
    kernel rhs(t, y, p)
      u = y[0]
      m = p[0]
      z = m * u
      z_2 = u * m
      z_3 = z + z_2
      dead = m * m
      z_4 = m * 2.0
      z_5 = z_3 * z_4
      out[0] = z_5
    """
)
LAYOUT = Layout((), (), ("m",), (), (), (), (), (), 0, 0, {})
EVERY = [value for value in vars(pipelines).values() if isinstance(value, Pipeline)]


@dataclass(frozen=True)
class Breaking:
    """A pass that makes an output of nothing."""

    name: ClassVar[str] = "breaking"

    def __call__(self, kernel):
        return replace(kernel, outputs=("lost",))


@dataclass(frozen=True)
class Forbidden:
    """A pass that must not be reached."""

    name: ClassVar[str] = "forbidden"

    def __call__(self, kernel):
        raise AssertionError("a pass took what is not verified")


def test_the_verifier_runs_before_and_after_every_pass():
    with pytest.raises(MalformedKernel, match="lost"):
        Pipeline((Breaking(), Forbidden()))(KERNEL)
    with pytest.raises(MalformedKernel, match="lost"):
        Pipeline((Forbidden(),))(Breaking()(KERNEL))
    with pytest.raises(MalformedKernel, match="lost"):
        Pipeline(())(Breaking()(KERNEL))


def test_kernels_of_a_program_are_verified():
    program = Program("scene", "minimal", LAYOUT, (KERNEL, Breaking()(KERNEL)), ())
    with pytest.raises(MalformedKernel, match="lost"):
        PROGRAM_PASSES(program)


def test_what_kernel_passes_record():
    records = []
    after = KERNEL_PASSES(KERNEL, records)
    assert after == KERNEL_PASSES(KERNEL)
    assert [record.name for record in records] == [step.name for step in KERNEL_PASSES.passes]
    counts = [(record.before, record.after) for record in records]
    assert counts[0][0] == {"rhs": 6}
    assert counts[-1][1] == {"rhs": len(after.body)}
    assert all(left[1] == right[0] for left, right in pairwise(counts))
    assert all(record.seconds >= 0.0 for record in records)
    assert {r.name: r.before["rhs"] - r.after["rhs"] for r in records} == {
        "group products": 0,
        "share reciprocals": 0,
        "share equal": 1,
        "eliminate dead code": 1,
    }


def test_what_program_passes_record():
    records = []
    PROGRAM_PASSES(Program("scene", "minimal", LAYOUT, (KERNEL_PASSES(KERNEL),), ()), records)
    (record,) = records
    assert record.name == "hoist parameters"
    assert (record.before, record.after) == ({"rhs": 4}, {"prepare": 1, "rhs": 3})


@pytest.mark.parametrize("pipeline", EVERY)
def test_pipelines_are_data(pipeline):
    assert hash(pipeline) == hash(replace(pipeline))
    assert eval(repr(pipeline), vars(pipelines)) == pipeline
    for step in pipeline.passes:
        assert is_dataclass(step) and step.name
        with pytest.raises(FrozenInstanceError):
            step.name = "other"
        assert all(isinstance(getattr(step, field.name), int | str | tuple) for field in fields(step))


def test_pipelines_with_other_options_differ():
    assert Pipeline((ShareEqual(),)) != Pipeline((ShareEqual(commutative=()),))
    assert Pipeline((ShareEqual(), EliminateDeadCode())) != Pipeline((EliminateDeadCode(), ShareEqual()))
