"""Example scenes: the worked examples of section 13.4, and scenes with contacts."""

from collections.abc import Callable

from dalembert.scene import Scene
from dalembert.scenes.contacts import belt_oscillator, billiard_ball, bouncing_ball, sliding_rod
from dalembert.scenes.examples import chaplygin_sleigh, corner_plate, edge_plate, rolling_sphere

#: Every example of section 13.4 by the name of its builder; tests are parametrised over it.
ALL: dict[str, Callable[[], Scene]] = {
    "chaplygin_sleigh": chaplygin_sleigh,
    "corner_plate": corner_plate,
    "edge_plate": edge_plate,
    "rolling_sphere": rolling_sphere,
}

#: Scenes with friction and contacts by the names of their builders.
WITH_CONTACTS: dict[str, Callable[[], Scene]] = {
    "belt_oscillator": belt_oscillator,
    "billiard_ball": billiard_ball,
    "bouncing_ball": bouncing_ball,
    "sliding_rod": sliding_rod,
}

__all__ = [
    "ALL",
    "WITH_CONTACTS",
    "belt_oscillator",
    "billiard_ball",
    "bouncing_ball",
    "chaplygin_sleigh",
    "corner_plate",
    "edge_plate",
    "rolling_sphere",
    "sliding_rod",
]
