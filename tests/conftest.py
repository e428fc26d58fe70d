import os

from hypothesis import settings

os.environ.setdefault("MPLBACKEND", "Agg")
# XLA compiles in half the time to code that is slower; the tests run none for long.
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false")

# The first example of a property compiles a model, so that no deadline fits all of them.
settings.register_profile("dalembert", deadline=None, derandomize="CI" in os.environ, print_blob=True)
settings.load_profile("dalembert")
