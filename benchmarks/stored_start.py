"""Cost of the start of a worker of a stored sweep: imports, its model as a program and as a scene, compiled code."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from chains import spatial_chain

import dalembert as da
from dalembert.store.chunks import SweptModel
from dalembert.store.cluster import packed

__all__ = ["start_rows"]

_CHILD = """
import json, sys, time
begin = time.process_time()
import dask, distributed, xarray, zarr
import dalembert as da
from dalembert.store.cluster import unpacked
imported = time.process_time()
data = open(sys.argv[1], "rb").read()
if sys.argv[2] == "program":
    model = unpacked(data).model
else:
    import pickle
    model = pickle.loads(data)
made = time.process_time()
model.sweep((0, 0.01), *json.load(open(sys.argv[3])), threads=1)
print(json.dumps([imported - begin, made - imported, time.process_time() - made]))
"""

Case = tuple[Any, Mapping[str, Any], Mapping[str, Any]]


def _chain(links: int) -> Case:
    """Return model, initial values and parameters of a chain in space."""
    model = da.compile_model(spatial_chain(links))
    start = dict.fromkeys((*model.layout.coordinates, *model.layout.rates), 0.1)
    return model, start, dict.fromkeys(model.layout.parameters, 1.0)


def _child(data: bytes, kind: str, case: Case, cache: str) -> list[float]:
    """Return CPU seconds of a new process: for imports, for the model, and for a first sweep."""
    with tempfile.TemporaryDirectory() as folder:
        model, given = Path(folder, "model"), Path(folder, "given")
        model.write_bytes(data)
        given.write_text(json.dumps([dict(case[1]), dict(case[2])]))
        command = [sys.executable, "-c", _CHILD, str(model), kind, str(given)]
        environment = {**os.environ, "DALEMBERT_CACHE_DIR": cache}
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    found: list[float] = json.loads(done.stdout)
    return found


def start_rows(cases: Mapping[str, Case]) -> list[list[str]]:
    """Return rows of the start of a worker, for models with initial values and parameters of one case, and a chain."""
    rows = []
    for name, case in {**cases, "chain of 12 links in space": _chain(12)}.items():
        program, scene = packed(SweptModel(case[0])), pickle.dumps(case[0])
        with tempfile.TemporaryDirectory() as cache:
            first = _child(program, "program", case, cache)
            second = _child(program, "program", case, cache)
            derived = _child(scene, "scene", case, cache)
        seconds = (second[0], second[1], derived[1], first[2], second[2])
        rows.append([name, f"{len(program) / 1e3:.0f}", *(f"{each:.3f}" for each in seconds)])
    return rows
