import os

from hypothesis import settings

os.environ.setdefault("MPLBACKEND", "Agg")

# The first example of a property compiles a model, so that no deadline fits all of them.
settings.register_profile("dalembert", deadline=None, derandomize="CI" in os.environ, print_blob=True)
settings.load_profile("dalembert")
