"""Small C functions that translated kernels call, and names that they must not take."""

from __future__ import annotations

HELPERS = {
    "smaller": """/* the second where it is less, else the first: NaN comes through as in Python */
static double smaller(double a, double b)
{
    return (b < a) ? b : a;
}""",
    "larger": """/* the second where it is more, else the first */
static double larger(double a, double b)
{
    return (b > a) ? b : a;
}""",
    "smaller_long": """static long smaller_long(long a, long b)
{
    return (b < a) ? b : a;
}""",
    "larger_long": """static long larger_long(long a, long b)
{
    return (b > a) ? b : a;
}""",
    "squared": """static double squared(double x)
{
    return x * x;
}""",
}

_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int long
register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
bool true false main asm typeof
NAN INFINITY isnan isfinite isinf signbit exp log sqrt fabs floor ceil pow copysign round trunc remainder
div abs labs index gamma j0 j1 jn y0 y1 yn scalb drem signal remove rename time clock read write link pause
"""

RESERVED = frozenset(_WORDS.split()) | frozenset(HELPERS)
"""Words of C, and names of its library that a compiler knows the meaning of."""
