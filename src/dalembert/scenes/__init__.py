"""Ready scenes: the worked examples of section 13.4, each written as a user would write it."""

from collections.abc import Callable

from dalembert.scene import Scene
from dalembert.scenes.chaplygin_sleigh import chaplygin_sleigh
from dalembert.scenes.corner_plate import corner_plate
from dalembert.scenes.edge_plate import edge_plate
from dalembert.scenes.rolling_sphere import rolling_sphere

#: Every ready scene by the name of its builder; tests are parametrised over it.
ALL: dict[str, Callable[[], Scene]] = {
    "chaplygin_sleigh": chaplygin_sleigh,
    "corner_plate": corner_plate,
    "edge_plate": edge_plate,
    "rolling_sphere": rolling_sphere,
}

__all__ = ["ALL", "chaplygin_sleigh", "corner_plate", "edge_plate", "rolling_sphere"]
