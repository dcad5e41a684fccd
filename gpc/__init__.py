"""Polynomial chaos: orthonormal polynomials of random variables, and Gauss rules for their expectations."""

from gpc.basis import Family, Hermite, Jacobi, Legendre, beta_rule
from gpc.errors import ChaosError

__all__ = ["ChaosError", "Family", "Hermite", "Jacobi", "Legendre", "beta_rule"]
