"""A motion of every ready scene, and its runs on the numba backend beside those on the default one."""

import warnings
from functools import cache

import numpy as np

import dalembert as da
from corpus.named_scenes import READY, Ready
from dalembert.errors import DalembertError
from hard_cases.contacts import belt, billiard, bouncing, rod_stops

CONTACTS = {
    "belt_oscillator": (belt, 8.0),
    "billiard_ball": (billiard, 1.0),
    "bouncing_ball": (bouncing, 1.2),
    "sliding_rod": (rod_stops, 0.4),
}
"""Scenes with contacts: their motion in the hard cases, and how long it is followed here."""


def ready(name):
    """Return a run of a ready scene."""
    if name not in CONTACTS:
        return READY[f"ready: {name}"]
    make, end = CONTACTS[name]
    motion = make().motion
    return Ready(getattr(da.scenes, name), dict(motion.initial), dict(motion.parameters), (0.0, end))


@cache
def compiled(name, formulation, backend):
    """Return the model of a ready scene, or the error that refuses it."""
    try:
        return da.compile_model(ready(name).build(), formulation=formulation, backend=backend)
    except DalembertError as refusal:
        return refusal


def motion(name, formulation, backend, run, **options):
    """Return what `run` ("simulate" or "sweep") makes of a ready scene, or the error that refuses it."""
    model, case = compiled(name, formulation, backend), ready(name)
    if isinstance(model, DalembertError):
        return model
    parameters = dict(case.parameters)
    if run == "sweep":
        first = next(iter(parameters))
        parameters[first] *= np.array([1.0, 1.01, 0.98])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return getattr(model, run)(case.span, case.initial, parameters, rtol=1e-9, **options)
        except DalembertError as refusal:
            return refusal


def assert_agreement(name, formulation, run, **options):
    """Assert that both backends do the same: the same refusal, or the same motion up to rounding."""
    ours, theirs = (motion(name, formulation, backend, run, **options) for backend in ("numba", "llvm"))
    if isinstance(theirs, DalembertError):
        assert type(ours) is type(theirs) and str(ours).replace("numba", "llvm") == str(theirs)
        return
    np.testing.assert_array_equal(ours.status, theirs.status)
    layout = compiled(name, formulation, "llvm").layout
    for key in (*layout.coordinates, *layout.rates):
        found, expected = (np.asarray(one[key])[..., -1:] if run == "simulate" else one[key] for one in (ours, theirs))
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11, err_msg=key)
    if run == "sweep":
        for key, totals in theirs.reduced.items():
            np.testing.assert_allclose(ours.reduced[key], totals, rtol=1e-11, atol=1e-11, err_msg=key)
