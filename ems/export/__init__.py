"""Policies as C99 source and as FMUs: no heap, no Python at run time, the same decisions."""
