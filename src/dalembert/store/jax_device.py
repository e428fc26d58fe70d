"""The device of a process of a cluster that runs JAX."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, TypeVar

D = TypeVar("D")


def device_of(worker: Any, devices: Sequence[D]) -> D:
    """Return which of the devices that a worker sees is its own: they go round by the last number in its name.

    Workers are numbered from 0 by the clusters of dask; one that sees a single device, as those of dask-cuda do, has
    that one.
    """
    numbers = re.findall(r"\d+", str(worker))
    return devices[int(numbers[-1]) % len(devices) if numbers else 0]


def take_own_device() -> None:
    """Let this process of a cluster compute on a device of its own."""
    import jax
    from distributed import get_worker

    devices = jax.local_devices()
    if len(devices) > 1:
        jax.config.update(  # type: ignore[no-untyped-call]
            "jax_default_device", device_of(get_worker().name, devices)
        )
