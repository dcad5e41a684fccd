"""How fast the solver is against plain versions of itself: `make bench`, or `python -m benchmarks`."""
