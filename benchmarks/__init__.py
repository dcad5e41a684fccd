"""How fast solver, cells and estimators are against plain versions of themselves: `make bench`."""

import os

# Everything is timed on one thread; this has to be said before NumPy is first imported.
for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
