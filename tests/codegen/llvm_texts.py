"""Texts of LLVM assembly, one or more a template, of programs written by hand."""

from functools import partial
from unittest import mock

from codegen.programs import every_operation, oscillator, pendulum
from dalembert.codegen.lane_runs import advance_lanes_assembly, check_inputs_assembly
from dalembert.codegen.llvm import assembly as llvm_assembly
from dalembert.codegen.llvm.assembly import assembly
from dalembert.codegen.llvm.backend import LLVMLibrary, attempt_assembly
from dalembert.codegen.llvm.definitions import with_definitions
from dalembert.codegen.llvm.direct_call import direct_call_assembly
from dalembert.codegen.llvm.order_loops import order_loop_assembly
from dalembert.codegen.llvm.series_loops import series_loop_assembly
from dalembert.methods.tableaus import TABLEAUS
from dalembert.transforms.kernel_pieces import pieces_of
from dalembert.transforms.taylor.order_pass import LEAST_ORDER
from dalembert.transforms.taylor.recurrences import recurrences


def _kernels(program, lanes, *, exact=False):
    return assembly([(kernel.name, kernel) for kernel in program], lanes, exact=exact)


def _pieces(lanes):
    cut = partial(pieces_of, longest=1, size=3)
    with mock.patch.object(llvm_assembly, "pieces_of", cut):
        return assembly([("rhs", pendulum())], lanes)


def _calls(lanes):
    (tableau,) = (tableau for tableau in TABLEAUS if tableau.name == "tsit5")
    rhs = oscillator().kernel("rhs")
    return attempt_assembly(rhs, tableau, lanes, dense=False, carried=False, inline=False)


def _order_loop(lanes, width, *, dense=True):
    known = recurrences(pendulum())
    return order_loop_assembly("step", known, LEAST_ORDER, lanes, width, dense=dense)


def _series_loop(lanes, *, dense=True):
    return series_loop_assembly("step", recurrences(pendulum()), 3, lanes, dense=dense)


TEXTS = {
    "oscillator_llvm": lambda: _kernels(oscillator(), 1),
    "every_operation_llvm": lambda: _kernels(every_operation(), 2, exact=True),
    "oscillator_attempt_calls": lambda: _calls(2),
    "pendulum_pieces": lambda: _pieces(1),
    "pendulum_order_loop": lambda: _order_loop(1, 2),
    "pendulum_series_loop": lambda: _series_loop(1),
    "advance_lanes": lambda: advance_lanes_assembly(4),
    "check_inputs": lambda: check_inputs_assembly(4),
    "direct_call": direct_call_assembly,
}
"""What golden files hold, by their names."""

FURTHER_TEXTS = (
    lambda: LLVMLibrary(oscillator(), None).source("dop853", 0),
    lambda: _kernels(oscillator(), 4),
    lambda: with_definitions(_kernels(every_operation(), 4)),
    lambda: _pieces(4),
    lambda: _calls(4),
    lambda: _order_loop(2, 1, dense=False),
    lambda: _series_loop(4, dense=False),
    lambda: advance_lanes_assembly(1),
    lambda: check_inputs_assembly(1),
)
"""The same templates with other lanes and options."""
