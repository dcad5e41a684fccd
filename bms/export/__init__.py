"""Estimators as C99 source: no heap, no Python at run time, the same numbers."""
