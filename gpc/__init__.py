"""Polynomial chaos: orthonormal bases, index sets, collocation, Galerkin operators, expansions, a filter."""

from gpc.basis import Family, Hermite, Jacobi, Legendre, beta_rule
from gpc.belief import ChaosBelief, Innovation, normalised_square
from gpc.collocation import Collocation, collocate, quadrature, regression
from gpc.consistency import Consistency, nees
from gpc.ekf import GpcEkf
from gpc.errors import ChaosError
from gpc.expansion import Expansion, affine_coefficients, sample_germs
from gpc.galerkin import LinearSystem, germ_matrix, multiplication, triple_products, uncertain_decay
from gpc.index_set import count_terms, hyperbolic, total_order
from gpc.inflation import Inflation, scatter
from gpc.kernel_cache import provide_folder
from gpc.nodes import basis_matrix, selected_nodes, tensor_grid

__all__ = [
    "ChaosBelief",
    "ChaosError",
    "Collocation",
    "Consistency",
    "Expansion",
    "Family",
    "GpcEkf",
    "Hermite",
    "Inflation",
    "Innovation",
    "Jacobi",
    "Legendre",
    "LinearSystem",
    "affine_coefficients",
    "basis_matrix",
    "beta_rule",
    "collocate",
    "count_terms",
    "germ_matrix",
    "hyperbolic",
    "multiplication",
    "nees",
    "normalised_square",
    "quadrature",
    "regression",
    "sample_germs",
    "scatter",
    "selected_nodes",
    "tensor_grid",
    "total_order",
    "triple_products",
    "uncertain_decay",
]

provide_folder()
